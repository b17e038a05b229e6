"""The exact film: fixed-point sums that add up to the same bits in any order.

A sample's value v is rounded once to the integer rint(v * 2**film_exponent) and only integers are added, so a film does
not depend on tile size, batch size, the number of workers, or what died on the way. Plain numpy: the service merges with it.

Overflow cannot happen: |v| is clamped to SAMPLE_MAX = 2**18, the exponent is at most 24 and a pixel takes at most 2**20
samples, so every sum stays below 2**62.
"""

from __future__ import annotations

import hashlib
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = [
    "ALBEDO",
    "CHANNELS",
    "COLOR",
    "COLOR_EVEN",
    "DEPTH",
    "MATERIAL",
    "NORMAL",
    "OBJECT",
    "POSITION",
    "SAMPLES",
    "SAMPLES_EVEN",
    "SAMPLE_MAX",
    "BadSample",
    "BatchSums",
    "digest",
    "mean",
    "noise",
]

# Planes of a film or a batch's sums: an int64 array of shape (CHANNELS, height, width).
COLOR = slice(0, 3)  # linear Rec.709 radiance
COLOR_EVEN = slice(3, 6)  # the same over even sample numbers: the two halves' difference estimates the noise
ALBEDO = slice(6, 9)  # first hit's reflectance
NORMAL = slice(9, 12)  # first hit's world-space shading normal
DEPTH = 12  # distance from the eye to the first hit; 0 where nothing is hit
SAMPLES = 13  # samples that count (finite ones); a plain count, not fixed point
SAMPLES_EVEN = 14  # the even-numbered of them
POSITION = slice(15, 18)  # first hit's place in the world; 0 where nothing is hit
OBJECT = 18  # 1 + the number of the object that sample 0 hits first, 0 where it hits nothing; a plain number, not fixed point
MATERIAL = 19  # 1 + the number of its material, likewise
CHANNELS = 20

SAMPLE_MAX = 262144.0

Sums = npt.NDArray[np.int64]


class BadSample(NamedTuple):
    """A sample that was NaN or infinite, and so left out."""

    x: int
    y: int
    sample: int


class BatchSums(NamedTuple):
    """What rendering a batch gives: `sums` (CHANNELS, h, w) int64, and the samples left out (at most the first 64 of them)."""

    sums: Sums
    bad: list[BadSample]
    bad_count: int


def mean(sums: Sums, film_exponent: int, channel: slice | int = COLOR) -> npt.NDArray[np.float32]:
    """The mean of a channel: (h, w, 3) float32 for colours and vectors, (h, w) for depth; 0 where no sample is."""
    values = sums[channel].astype(np.float64) * 2.0**-film_exponent
    values /= np.maximum(sums[SAMPLES], 1)
    return np.ascontiguousarray(np.moveaxis(values, 0, -1) if values.ndim == 3 else values, dtype=np.float32)


def noise(sums: Sums, film_exponent: int) -> float:
    """A frame's or tile's relative noise: the standard error of its pixels over its mean, from the two half-sums.

    The even half's mean minus the odd half's has the variance s²(1/n_e + 1/n_o); the full mean's has s²/n. So the
    difference times sqrt(n_e n_o) / n estimates the full mean's standard error per pixel. inf where a half is empty.
    """
    n_even = sums[SAMPLES_EVEN].astype(np.float64)
    n = sums[SAMPLES].astype(np.float64)
    n_odd = n - n_even
    if n.size == 0 or n_even.min() < 1 or n_odd.min() < 1:
        return float("inf")
    scale = 2.0**-film_exponent
    even = sums[COLOR_EVEN] * scale / n_even
    odd = (sums[COLOR] - sums[COLOR_EVEN]) * scale / n_odd
    error = (even - odd) * np.sqrt(n_even * n_odd) / n
    total = float((sums[COLOR] * scale / n).mean())
    return float(np.sqrt((error**2).mean())) / max(total, 1e-6)


def digest(sums: Sums) -> str:
    """SHA-256 of a whole frame's sums and sample counts: little-endian int64, planes in order, rows from the top."""
    return hashlib.sha256(np.ascontiguousarray(sums, dtype="<i8").tobytes()).hexdigest()
