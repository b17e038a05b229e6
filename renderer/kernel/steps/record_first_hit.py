"""The AOVs (auxiliary film values) of a path's first vertex: their fields and values.

A new AOV needs a field of `FirstHit` and its value here, its planes in `FIRST_HIT` of renderer/film.py, and its entry in
renderer/aovs.py. The last four fields have no entry in those tables: only films with a transparent background have their planes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.film import CHANNELS, FIRST_HIT
from renderer.jit import device
from renderer.wide.fields import Float, Int, Vector, columns_of, is_integer
from renderer.wide.values import as_wide, u32, zero_like

__all__ = [
    "DEEP",
    "IDS",
    "MEANS",
    "FirstHit",
    "no_hit",
    "record_background",
    "record_catcher",
    "record_direct_light",
    "record_first_hit",
    "record_reflection",
    "with_albedo",
]

_NEXT, _NONE = np.uint32(1), np.uint32(0)
_THREE = np.float32(3.0)
_UNKNOWN = np.float32(-1.0)


class FirstHit(NamedTuple):
    """The values of a path's first vertex that the film stores. All fields are 0 if the path has no vertex."""

    albedo: Vector
    distance: Float  # from the lens
    normal: Vector  # zero for a vertex in a medium
    object: Int  # 1 + its number
    point: Vector
    material: Int  # 1 + its number
    # 0 unless the background is transparent:
    uncovered: Float  # 1 - alpha, apart from shadows that are caught
    caught: Float  # the same, if the vertex is on a catcher of shadows or reflections
    unshadowed: Float  # luminance of the light that arrives at the catcher without occlusion
    shadowed: Float  # and with it; negative while that is the path's radiance, until it meets an object or its end


@device
def record_first_hit(surface, material, normal, distance, start):
    """Returns the FirstHit of a path's first vertex.

    material: with base colour, metallic and roughness, as in `Parameters` and `Material`; in a medium the base colour is the
    single-scattering albedo. normal: the shading normal on the viewer's side; zero in a medium, where the surface has neither
    object nor material. distance: along the ray. start: distance of the ray's origin from the lens.
    """
    return FirstHit(
        albedo=material.base,
        distance=distance + start,
        normal=normal,
        object=u32(surface.object + _NEXT),
        point=surface.point,
        material=u32(surface.material + _NEXT),
        uncovered=zero_like(distance),
        caught=zero_like(distance),
        unshadowed=zero_like(distance),
        shadowed=zero_like(distance),
    )


@device
def with_albedo(hit, albedo):
    """Returns the FirstHit `hit` with another albedo: its RGB, where the material has reflectances at wavelengths."""
    seen = hit.uncovered, hit.caught, hit.unshadowed, hit.shadowed
    return FirstHit(albedo, hit.distance, hit.normal, hit.object, hit.point, hit.material, *seen)


@device
def no_hit(like):
    """Returns the FirstHit of a path that hits nothing. like: a float or lanes."""
    none, nothing = zero_like(like), as_wide(_NONE, like)
    black = none, none, none
    return FirstHit(black, none, black, nothing, black, nothing, none, none, none, none)


@device
def record_background(throughput):
    """Returns the FirstHit of a path that leaves the scene without a vertex, before a transparent background.

    throughput: of the path, less than 1 behind absorbing media. The mean of its channels is what the sample lacks in alpha.
    """
    hit = no_hit(throughput[0])
    none = hit.distance
    return FirstHit(hit.albedo, none, hit.normal, hit.object, hit.point, hit.material, _uncovered(throughput), none, none, none)


@device
def _uncovered(throughput):
    red, green, blue = throughput
    return (red + green + blue) / _THREE


@device
def record_catcher(hit, throughput):
    """Returns the FirstHit `hit`, whose vertex is on a catcher of shadows or reflections."""
    weight = _uncovered(throughput)
    none = zero_like(weight)
    return _with_caught(hit, weight, weight, none, none + _UNKNOWN)


@device
def record_direct_light(hit, light):
    """Returns the FirstHit `hit` of a vertex on a catcher with more direct light. light: its luminance if unoccluded."""
    return _with_caught(hit, hit.uncovered, hit.caught, hit.unshadowed + light, hit.shadowed)


@device
def record_reflection(hit, light):
    """Returns the FirstHit `hit` of a vertex on a catcher whose path has met an object.

    light: luminance of the light with occlusion that the vertex has received.
    """
    return _with_caught(hit, hit.uncovered, hit.caught, hit.unshadowed, light)


@device
def _with_caught(hit, uncovered, caught, unshadowed, shadowed):
    alpha = uncovered, caught, unshadowed, shadowed
    return FirstHit(hit.albedo, hit.distance, hit.normal, hit.object, hit.point, hit.material, *alpha)


def _planes(integers: bool) -> npt.NDArray[np.uintp]:
    """Returns (column of FirstHit, plane of the film), (n, 2), for each of FirstHit's integers or each of its real numbers.

    integers: True selects the integers.
    """
    found: list[tuple[int, int]] = []
    for field, planes in FIRST_HIT.items():
        if is_integer(FirstHit, field) == integers:
            numbers = range(CHANNELS)[planes] if isinstance(planes, slice) else [planes]
            found += zip(columns_of(FirstHit, field), numbers, strict=True)
    return np.array(found, np.uintp)


MEANS = _planes(integers=False)  # averaged over the samples
IDS = _planes(integers=True)  # cannot be averaged: of sample 0
# Columns of FirstHit that are recorded for each sample of a deep picture, in the order of renderer/deep_samples.py.
DEEP = np.array([k for field in ("distance", "point", "uncovered", "caught") for k in columns_of(FirstHit, field)], np.uintp)
