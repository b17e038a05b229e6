"""The kernel for graphics cards (GPUs): the scalar path tracer translated to PTX; each thread renders samples of one pixel.

Not yet tested on a graphics card in this version; the optimised LLVM code is tested on the CPU (tests/renderer/cuda).

megakernel.py  the kernel, and the job that is its argument
ptx.py         from Numba's LLVM code to PTX; checks that no operation rounds differently from the CPU
target.py      the minimum compute capability and driver

Detection of graphics cards, their driver, and rendering on them are in renderer/cuda.
"""
