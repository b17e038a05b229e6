"""Renders on NVIDIA graphics cards (GPUs), with the same bits as the CPU. Not yet tested on a graphics card in this version.

The kernel is in renderer/kernel/backends/cuda.

driver.py     NVIDIA's driver through ctypes
cards.py      which graphics cards can render, and why others cannot
verdicts.py   runs the self-test (renderer/self_test), and keeps its results
job.py        the kernel's argument: its type, and its bytes
artefacts.py  the kernels' PTX in the cache
render.py     renders batches on a graphics card
"""
