"""The kernels for graphics cards (GPUs), translated to PTX: stages for many paths, or one kernel that follows whole paths.

Not yet tested on a graphics card in this version; the optimised LLVM code is tested on the CPU (tests/renderer/cuda).

wavefront.py   a kernel for each stage of the pool of paths, a path a thread, and their argument; for the variants plain and full
megakernel.py  the scalar path tracer as one kernel, a thread renders samples of one pixel; for the other variants
atomics.py, local_zeros.py  what threads need in addition
ptx.py         from Numba's LLVM code to PTX; checks that no operation rounds differently from the CPU
target.py      the minimum compute capability and driver

Detection of graphics cards, their driver, and rendering on them are in renderer/cuda.
"""
