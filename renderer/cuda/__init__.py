"""Renders on NVIDIA graphics cards (GPUs), with the same bits as the CPU. Not yet tested on a graphics card in this version.

The kernel is in renderer/kernel/backends/cuda.

driver.py     NVIDIA's driver through ctypes
cards.py      which graphics cards can render, and why others cannot
self_test.py  compares films of built-in scenes with the CPU's: self_test_scenes.py; verdicts.py runs it and keeps the results
job.py        the kernel's argument: its type, and its bytes
artefacts.py  the kernels' PTX in the cache
render.py     renders batches on a graphics card
"""
