"""The exact film: fixed-point sums that have the same bits in any order of addition.

A sample's value v is rounded once to the integer rint(v * 2**film_exponent) and only integers are added, so a film does not
depend on tile size, batch size, the number of workers, or failures and retries. Plain numpy: the service merges films with it.

Overflow cannot happen: |v| is clamped to SAMPLE_MAX = 2**18, the exponent is at most 24 and a pixel takes at most 2**20
samples, so every sum stays below 2**62.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.cryptomatte import Hits
from renderer.deep import Deep
from renderer.luminance import REC_709

__all__ = [
    "ALBEDO",
    "ALPHA_PLANES",
    "CHANNELS",
    "COLOR",
    "COLOR_HALF",
    "DEPTH",
    "FIRST_HIT",
    "MATERIAL",
    "NORMAL",
    "OBJECT",
    "POSITION",
    "SAMPLES",
    "SAMPLES_HALF",
    "SAMPLE_MAX",
    "BadSample",
    "BatchSums",
    "Gain",
    "alpha",
    "alpha_plane",
    "bytes_of_deep",
    "bytes_of_hits",
    "catcher_shade",
    "digest",
    "error",
    "group_planes",
    "in_half",
    "is_plane_count",
    "least_samples",
    "mean",
    "mixed",
    "noise",
    "plane_count",
]

# Planes of a film or a batch's sums: an int64 array of shape (CHANNELS, height, width), or more planes with light groups.
COLOR = slice(0, 3)  # linear Rec.709 radiance
COLOR_HALF = slice(3, 6)  # the same over about half of the samples (`in_half`): its difference from the rest estimates the noise
ALBEDO = slice(6, 9)  # first hit's reflectance
NORMAL = slice(9, 12)  # first hit's world-space shading normal
DEPTH = 12  # distance to the first hit from the eye or lens; 0 where nothing is hit
SAMPLES = 13  # number of finite samples; a plain count, not fixed point
SAMPLES_HALF = 14  # number of finite samples that are in the half
POSITION = slice(15, 18)  # first hit's world position; 0 where nothing is hit
OBJECT = 18  # 1 + the number of the object that sample 0 hits first, 0 where it hits nothing; a plain number, not fixed point
MATERIAL = 19  # 1 + the number of the object's material, likewise
CHANNELS = 20

# Behind these, in films with light groups: three planes for each group, radiance as in COLOR. The groups add up to COLOR.
# The last planes of films with a transparent background are those of the alpha (`alpha_plane`).
_MOST_GROUPS = 27  # RenderSettings.light_planes
ALPHA_PLANES = 4

# The planes of each field of a sample's FirstHit (renderer/kernel/steps/record_first_hit.py). Both backends fill them from this
# table: real numbers are averaged over the samples, integers are those of sample 0.
FIRST_HIT: dict[str, slice | int] = {
    "albedo": ALBEDO,
    "distance": DEPTH,
    "normal": NORMAL,
    "object": OBJECT,
    "point": POSITION,
    "material": MATERIAL,
}

SAMPLE_MAX = 262144.0

_LEAST_SAMPLES = 16  # per pixel, and
_LEAST_OF_ALL = 512  # over all pixels, before a noise estimate may end a frame or a tile

Sums = npt.NDArray[np.int64]
Gain = tuple[float, float, float]  # factors of red, green and blue


class BadSample(NamedTuple):
    """A sample that was NaN or infinite and is therefore not in the film."""

    x: int
    y: int
    sample: int


class BatchSums(NamedTuple):
    """The result of a batch: its sums, (CHANNELS, h, w) int64, and the samples omitted as NaN or infinite (the first 64)."""

    sums: Sums
    bad: list[BadSample]
    bad_count: int
    hits: Hits | None = None  # for Cryptomatte, if it was requested (renderer/cryptomatte.py)
    deep: Deep | None = None  # deep pixels likewise (renderer/deep.py)


def group_planes(group: int) -> slice:
    """Returns the planes of a light group or light path, by its number in RenderSettings.light_planes."""
    return slice(CHANNELS + 3 * group, CHANNELS + 3 * group + 3)


def alpha_plane(groups: int) -> int:
    """Returns the first of the ALPHA_PLANES of a film with a transparent background and this many light groups.

    They are the coverage, 0 ... 1 a sample, without shadow catchers; the weight of the samples on shadow catchers; the luminance
    of the direct light that reaches these, without occlusion, and with it. `alpha` is computed from them.
    """
    return CHANNELS + 3 * groups


def alpha(sums: Sums, film_exponent: int, groups: int) -> npt.NDArray[np.float32]:
    """Returns the alpha of a film with a transparent background, (h, w) float32, 0 ... 1; 0 without samples.

    A shadow catcher covers as much as its direct light is blocked: 1 - (light with occlusion) / (light without), each summed over
    the pixel's samples. groups: number of light groups.
    """
    first = alpha_plane(groups)
    covered, caught = sums[first : first + 2].astype(np.float64)
    found = (covered + caught * catcher_shade(sums, groups)) * 2.0**-film_exponent
    return (found / np.maximum(sums[SAMPLES], 1)).astype(np.float32)


def catcher_shade(sums: Sums, groups: int) -> npt.NDArray[np.float64]:
    """Returns how much of a pixel's shadow catchers is in shadow, (h, w), 0 ... 1. Arguments as for `alpha`."""
    first = alpha_plane(groups)
    unshadowed, shadowed = sums[first + 2 : first + ALPHA_PLANES].astype(np.float64)
    light = np.divide(shadowed, unshadowed, out=np.ones_like(shadowed), where=unshadowed > 0)
    return 1 - np.clip(light, 0, 1)


def plane_count(groups: int, is_transparent: bool = False) -> int:
    """Returns the number of planes of a film with this many light groups and paths (RenderSettings.light_planes).

    is_transparent: whether its background is (RenderSettings.is_transparent).
    """
    return alpha_plane(groups) + (ALPHA_PLANES if is_transparent else 0)


def is_plane_count(planes: int) -> bool:
    """Returns True if a film can have this number of planes."""
    found = (divmod(planes - plane_count(0, is_transparent), 3) for is_transparent in (False, True))
    return any(further == 0 and 0 <= groups <= _MOST_GROUPS for groups, further in found)


def mean(sums: Sums, film_exponent: int, channel: slice | int = COLOR) -> npt.NDArray[np.float32]:
    """Returns the mean of a channel: (h, w, 3) float32 for colours and vectors, (h, w) for depth; 0 without samples."""
    values = sums[channel].astype(np.float64) * 2.0**-film_exponent
    values /= np.maximum(sums[SAMPLES], 1)
    return np.ascontiguousarray(np.moveaxis(values, 0, -1) if values.ndim == 3 else values, dtype=np.float32)


def mixed(sums: Sums, film_exponent: int, gains: Sequence[Gain]) -> npt.NDArray[np.float32]:
    """Returns the mean of a weighted sum of the light groups, (h, w, 3) float32; 0 without samples.

    gains: of red, green and blue, one triple per group, in the order of RenderSettings.group_names. Groups with the gain 0 are
    not read. With all gains 1 the result has the bits of the mean colour, since the groups' integers add up to the colour's.
    """
    values = np.zeros((3, *sums.shape[1:]))
    for group, gain in enumerate(gains):
        if any(gain):
            values += sums[group_planes(group)] * np.array(gain)[:, None, None]
    values *= 2.0**-film_exponent
    values /= np.maximum(sums[SAMPLES], 1)
    return np.ascontiguousarray(np.moveaxis(values, 0, -1), dtype=np.float32)


def in_half(sample: int) -> bool:
    """Returns True if a sample number is in the half buffer for noise estimation: in the first half of its [2**k, 2**(k+1)).

    These are 0, 2, 4, 5, 8 ... 11, 16 ... 23 and so on. Both halves consist of blocks of 2**k numbers that begin at a multiple of
    2**k: well distributed points of Sobol', whose shuffled sequence puts such a block into either half with equal probability.
    The halves are then as uniform as any shorter run of samples, and their difference measures the remaining noise of the
    sampler. Halves of even and odd numbers would be two halves of a coarse pattern, and the estimate that of independent samples.
    """
    return sample == 0 or (sample > 1 and sample < 3 << (sample.bit_length() - 2))


def _halves(sums: Sums, film_exponent: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Returns (signed standard error of each pixel's mean colour, the mean colour), (3, h, w) each.

    The error is estimated from the two halves of the samples. The difference of the halves' means has the variance s²(1/a + 1/b)
    for a and b independent samples; the full mean has s²/(a + b). So the difference times sqrt(a b) / (a + b) estimates the full
    mean's standard error; its sign has no meaning. NaN where a half is empty.
    """
    half = sums[SAMPLES_HALF].astype(np.float64)
    n = sums[SAMPLES].astype(np.float64)
    rest = n - half
    scale = 2.0**-film_exponent
    with np.errstate(invalid="ignore", divide="ignore"):
        first = sums[COLOR_HALF] * scale / half
        second = (sums[COLOR] - sums[COLOR_HALF]) * scale / rest
        deviation = (first - second) * np.sqrt(half * rest) / n
        return np.where((half > 0) & (rest > 0), deviation, np.nan), sums[COLOR] * scale / n


def error(sums: Sums, film_exponent: int, relative: bool = False) -> npt.NDArray[np.float32]:
    """Returns the standard error of each pixel's luminance, or if `relative` its ratio to the luminance: (h, w) float32.

    inf where unknown. Estimated from two halves of the samples: correct on average (root mean square) over many pixels, rough for
    each pixel. For samples of the Sobol' sequence the estimate is an upper bound.
    """
    deviation, color = _halves(sums, film_exponent)
    found = np.abs(np.tensordot(REC_709, deviation, 1))
    if relative:
        found = np.divide(found, np.tensordot(REC_709, color, 1), out=np.where(found > 0, np.inf, 0.0), where=found > 0)
    return np.where(np.isnan(found), np.inf, found).astype(np.float32)


def noise(sums: Sums, film_exponent: int) -> float:
    """Returns the relative noise of a frame or tile: the root mean square of its pixels' standard errors divided by its mean.

    inf if a pixel has samples in one half only.
    """
    deviation, color = _halves(sums, film_exponent)
    if deviation.size == 0 or np.isnan(deviation).any():
        return float("inf")
    return float(np.sqrt((deviation**2).mean())) / max(float(color.mean()), 1e-6)


def least_samples(pixels: int) -> int:
    """Returns the minimum spp before a noise limit may end a frame or tile of this many pixels.

    The estimate of `noise` has as many degrees of freedom as pixels. It is too low by chance if both halves of few samples lack
    the same rare, bright samples; then the mean is too low as well. With 512 samples over all pixels, a light that one sample in
    fifty finds is off by 1 % on average; with 32 samples of a single pixel, by 28 %.
    """
    return max(_LEAST_SAMPLES, -(-_LEAST_OF_ALL // max(pixels, 1)))


def digest(sums: Sums, hits: Hits | None = None, deep: Deep | None = None) -> str:
    """Returns the SHA-256 of a whole frame's sums and sample counts: little-endian int64, planes in order, rows from the top.

    hits: Cryptomatte's counts of the frame, if they were requested; `bytes_of_hits` follows the planes. deep: deep pixels
    likewise; `bytes_of_deep` is the last.
    """
    found = hashlib.sha256(np.ascontiguousarray(sums, dtype="<i8").tobytes())
    if hits is not None:
        found.update(bytes_of_hits(hits))
    if deep is not None:
        found.update(bytes_of_deep(deep))
    return found.hexdigest()


def bytes_of_hits(hits: Hits) -> bytes:
    """Returns Cryptomatte's counts as the digest covers them: pairs of key and count, little-endian 64-bit integers."""
    return np.stack([hits.key.astype("<u8"), hits.count.astype("<u8")], axis=1).tobytes()


def bytes_of_deep(deep: Deep) -> bytes:
    """Returns deep pixels as the digest covers them: little-endian, for each entry its key, its sums and its two depths.

    Those of a frame are those of its bands of rows, one after the other.
    """
    depths = np.stack([deep.near, deep.far], axis=1).astype("<f4").view("<i8")
    return np.concatenate([deep.key.astype("<u8").view("<i8")[:, None], deep.sums.astype("<i8"), depths], axis=1).tobytes()
