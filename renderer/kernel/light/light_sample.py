"""The result of sampling a light (LightSample), and selections between samples, lane by lane."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.material.material import emission, opacity
from renderer.kernel.spectrum.upsampling import light_at
from renderer.wide.values import any_of, as_wide, not_, where, where3, zero_like

__all__ = ["LightSample", "emitted", "empty_light_sample", "if_found", "light_sample_at", "select_light_sample"]

_ONE = np.float32(1.0)


class LightSample(NamedTuple):
    """A sampled direction towards a light, with radiance, distance and pdf.

    Vectors are tuples of float32 in world space; each number may be a vector of eight lanes.
    """

    direction: tuple[float, float, float]  # unit, from the shaded point
    end: tuple[float, float, float]  # the point that must be visible from the shaded point
    radiance: tuple[float, float, float]  # arriving at the shaded point without occlusion
    pdf: float  # per steradian, includes the probability of choosing the light; 0: no sample
    alone: bool  # whether rays cannot hit the light, so that MIS does not apply


@device
def empty_light_sample(p):
    """Returns an empty LightSample, with pdf 0. p: a point, which determines the lane type."""
    zero, one = zero_like(p[0]), as_wide(_ONE, p[0])
    black = zero, zero, zero
    return LightSample((zero, zero, one), black, black, zero, as_wide(False, p[0]))


@device
def select_light_sample(choice, a, b):
    """Returns LightSample a in lanes where `choice` is True, b in the others."""
    return LightSample(
        where3(choice, a.direction, b.direction),
        where3(choice, a.end, b.end),
        where3(choice, a.radiance, b.radiance),
        where(choice, a.pdf, b.pdf),
        where(choice, a.alone, b.alone),
    )


@device
def if_found(found, sample, p):
    """Returns `sample` in the lanes where `found` is True, and an empty LightSample (`empty_light_sample`) in the others."""
    if any_of(not_(found)):
        sample = select_light_sample(found, sample, empty_light_sample(p))
    return sample


@device
def light_sample_at(scene, sample, wavelengths):
    """Returns the LightSample with its radiance at a path's wavelengths; see `light_at` (kernel/spectrum/upsampling.py)."""
    radiance = light_at(scene, sample.radiance, wavelengths)
    return LightSample(sample.direction, sample.end, radiance, sample.pdf, sample.alone)


@device
def emitted(scene, material, uv, uv1, vertex_alpha, front, time):
    """Returns the radiance, rgb, that a material emits, times its opacity.

    Opacity counts because rays pass through the light with probability 1 - alpha.
    """
    radiance = emission(scene, material, uv, uv1, front, time)
    return vec.scale(radiance, opacity(scene, material, uv, uv1, vertex_alpha, time))
