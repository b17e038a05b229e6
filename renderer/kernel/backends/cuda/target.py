"""The compilation target of kernels for graphics cards."""

from __future__ import annotations

__all__ = ["CAPABILITY", "CUDA_VERSION", "PTX_VERSION"]

CAPABILITY = (7, 0)  # least compute capability: Volta, 2017
PTX_VERSION = (8, 1)  # first with parameters of more than 4 kB
CUDA_VERSION = (12, 1)  # of the driver; first with that version of PTX
