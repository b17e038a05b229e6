"""The kernels for graphics cards (GPUs), translated to PTX: the stages of the pool for many paths, a path a thread.

Not yet tested on a graphics card in this version; the optimised LLVM code is tested on the CPU (tests/renderer/cuda).

wavefront.py   the kernels, one for each stage, and their argument
atomics.py, local_zeros.py  what threads need in addition
ptx.py         from Numba's LLVM code to PTX; checks that no operation rounds differently from the CPU
target.py      the minimum compute capability and driver

Detection of graphics cards, their driver, and rendering on them are in renderer/cuda.
"""
