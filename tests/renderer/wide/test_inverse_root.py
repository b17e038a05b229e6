"""Tests of the approximate 1 / sqrt(x) against NumPy."""

import numpy as np

from renderer.bvh.simd import load, store
from renderer.jit import entry
from renderer.wide.inverse_root import inverse_root


@entry
def _roots(x, out):
    for i in range(0, len(x), 8):
        store(out, np.uintp(i), inverse_root(load(x, np.uintp(i))))


def test_inverse_root_precision():
    mantissas = np.linspace(1, 4, 2**14, endpoint=False, dtype=np.float32)  # the error repeats every second exponent
    x = np.ldexp(mantissas, np.arange(-124, 124, 62)[:, None]).astype(np.float32).ravel()
    found = np.zeros_like(x)
    _roots(x, found)
    assert abs(found * np.sqrt(x.astype(np.float64)) - 1).max() < 7e-4
