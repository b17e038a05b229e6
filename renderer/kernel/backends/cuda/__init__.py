"""The kernel of graphics cards: the paths of the scalar backend, one thread for samples of one pixel, translated to PTX.

Not yet tested on a card in this version; the optimised LLVM code is tested on the CPU (tests/renderer/cuda).

megakernel.py  the kernel, and the job that is its argument
ptx.py         from Numba's LLVM code to PTX; checks that no operation rounds differently from the CPU
target.py      the minimum compute capability and driver

Cards, the driver and rendering on a card are in renderer/cuda.
"""
