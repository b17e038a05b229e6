"""Deep samples: from what a kernel records of each sample to exact sums, and from these to the samples of a deep picture."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.cryptomatte import NOT_FINITE
from renderer.deep import CAUGHT, COUNT, FAR, LIGHT, SUMS, UNCOVERED, Deep, binned, pixels_of
from renderer.film import SAMPLE_MAX, SAMPLES, Sums, catcher_shade

__all__ = ["CHANNELS", "RECORD", "DeepRows", "Sight", "deep_rows", "sum_samples"]

F32 = npt.NDArray[np.float32]
U32 = npt.NDArray[np.uint32]

# Columns of a sample's record, float32: its radiance; of its FirstHit the distance, the point, `uncovered` and `caught`.
_RADIANCE, _DISTANCE, _POINT, _UNCOVERED, _CAUGHT = slice(0, 3), 3, slice(4, 7), 7, 8
RECORD = 9
CHANNELS = ("A", "B", "G", "R", "Z", "ZBack")  # of a deep picture, in the order of a file


class Sight(NamedTuple):
    """The axis along which the depth of points is measured.

    eye: its origin. forward: its unit direction; None if depth is the distance from the eye.
    """

    eye: tuple[float, float, float]
    forward: tuple[float, float, float] | None


class DeepRows(NamedTuple):
    """Rows of a deep picture. count: (h, w) int64, samples of each pixel. values: (samples, channels) float32, by CHANNELS.

    The samples of a pixel are in order of depth and do not overlap. Z and ZBack: where a sample begins and ends. A: alpha of the
    sample alone. R, G, B: premultiplied by it. Composited over each other they give the colour and the alpha of the pixel.
    """

    count: npt.NDArray[np.int64]  # type: ignore[assignment]  # hides tuple.count, which is not used
    values: F32


def sum_samples(ids: U32, records: F32, sight: Sight, film_exponent: int, most: int) -> Deep:
    """Returns the exact sums by depth of samples. ids, records: (pixels, samples) and (pixels, samples, RECORD).

    ids: NOT_FINITE for samples that are not in the film. sight: in the coordinates of the
    records. most: greatest number of bins of a pixel. Samples that neither shine nor cover anything are left out.
    """
    is_kept = (ids != NOT_FINITE) & ((records[..., _UNCOVERED] != 1) | records[..., _RADIANCE].any(axis=-1))
    is_kept |= (ids != NOT_FINITE) & (records[..., _CAUGHT] > 0)
    pixel = np.nonzero(is_kept)[0]
    known = records[is_kept]
    sums = np.empty((len(known), SUMS), np.int64)
    sums[:, COUNT] = 1
    for column, values in ((UNCOVERED, known[:, _UNCOVERED]), (CAUGHT, known[:, _CAUGHT]), (LIGHT, known[:, _RADIANCE])):
        sums[:, column] = np.rint(np.clip(values, -SAMPLE_MAX, SAMPLE_MAX).astype(np.float64) * 2.0**film_exponent)
    return binned(most, pixel, _depth(known, sight), sums)


def _depth(known: F32, sight: Sight) -> F32:
    """Returns the depth of each record, (n,) float32; FAR for those that hit nothing."""
    depth = distance = known[:, _DISTANCE]
    if sight.forward is not None:
        points = known[:, _POINT].astype(np.float64)
        x, y, z = ((points[:, k] - sight.eye[k]) * sight.forward[k] for k in range(3))
        depth = ((x + y) + z).astype(np.float32)
    return np.where(distance > 0, depth, FAR)


def deep_rows(deep: Deep, sums: Sums, film_exponent: int, groups: int, is_transparent: bool) -> DeepRows:
    """Returns the samples of a deep picture. deep: with pixel indices in `sums`, which are of the same samples.

    sums: planes of a film with this number of light groups and paths. is_transparent: whether its background is.

    A bin covers the share w of a pixel and adds the light c to its mean. What is before it lets the share T through: so its
    sample has the alpha w / T and the premultiplied colour c / T. T is at least the share of the samples in the bin.
    """
    height, width = sums.shape[1:]
    pixel, one = pixels_of(deep), 2.0**film_exponent
    covered = deep.sums[:, COUNT] * one - deep.sums[:, UNCOVERED]
    if is_transparent:
        covered += deep.sums[:, CAUGHT] * catcher_shade(sums, groups).reshape(-1)[pixel]
    light = deep.sums[:, LIGHT]
    is_kept = (covered > 0) | light.any(axis=1)
    pixel, covered, light = pixel[is_kept], covered[is_kept], light[is_kept]
    before = np.cumsum(covered) - covered
    count = np.bincount(pixel, minlength=height * width)
    first = np.cumsum(count) - count
    whole = np.maximum(sums[SAMPLES].reshape(-1), 1)[pixel] * one
    through = whole - (before - before[first[pixel]])
    through = np.maximum(through, deep.sums[is_kept, COUNT] * one)
    values = np.empty((len(pixel), len(CHANNELS)), np.float32)
    values[:, 0] = np.clip(covered / through, 0, 1)
    values[:, 1:4] = light[:, ::-1] / through[:, None]
    values[:, 4], values[:, 5] = deep.near[is_kept], deep.far[is_kept]
    return DeepRows(count.reshape(height, width), values)
