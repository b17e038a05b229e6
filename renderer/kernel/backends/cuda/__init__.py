"""The kernel of graphics cards: the scalar backend's paths, one thread for samples of one pixel, translated to PTX.

Not yet tried on a card in this version: the optimised LLVM code is tested on the CPU (tests/renderer/cuda).

megakernel.py  the kernel, and the job that is its argument
ptx.py         from Numba's LLVM code to PTX; checks that no operation rounds differently from the CPU
target.py      the least compute capability and driver

Cards, the driver and rendering on one are in renderer/cuda.
"""
