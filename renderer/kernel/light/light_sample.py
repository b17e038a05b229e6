"""A sample of a light: its fields, and how samples of several lanes are put together."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.material.material import emission, opacity
from renderer.wide.values import any_of, as_wide, nil, not_, where, where3

__all__ = ["LightSample", "either", "emitted", "if_found", "nothing"]

_ONE = np.float32(1.0)


class LightSample(NamedTuple):
    """A direction that light comes from. Vectors are tuples of float32 in world space; or all of it is of eight lanes."""

    direction: tuple[float, float, float]  # unit, from the point lit
    end: tuple[float, float, float]  # what must be seen from the point lit
    radiance: tuple[float, float, float]  # that would arrive unoccluded
    pdf: float  # per steradian, the choice of the light included; 0: nothing sampled
    alone: bool  # whether only light sampling finds it (no ray meets it), so that there is nothing to weigh it against


@device
def nothing(p):
    """No sample at p."""
    zero, one = nil(p[0]), as_wide(_ONE, p[0])
    black = zero, zero, zero
    return LightSample((zero, zero, one), black, black, zero, as_wide(False, p[0]))


@device
def either(choice, a, b):
    """`where` of samples."""
    return LightSample(
        where3(choice, a.direction, b.direction),
        where3(choice, a.end, b.end),
        where3(choice, a.radiance, b.radiance),
        where(choice, a.pdf, b.pdf),
        where(choice, a.alone, b.alone),
    )


@device
def if_found(found, sample, p):
    """The sample, or nothing where there is none; there mostly is."""
    if any_of(not_(found)):
        sample = either(found, sample, nothing(p))
    return sample


@device
def emitted(scene, material, uv, uv1, vertex_alpha, front, time):
    """What rays that meet the light there receive on average: those that its alpha lets pass receive nothing of it."""
    radiance = emission(scene, material, uv, uv1, front, time)
    return vec.scale(radiance, opacity(scene, material, uv, uv1, vertex_alpha, time))
