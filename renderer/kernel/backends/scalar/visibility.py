"""Visibility and transmittance between two points."""

from __future__ import annotations

import math

import numpy as np

from renderer.bvh.traverse import FROM_ORIGIN, NO_PRIMITIVE, any_hit, closest_hit, shadow_root
from renderer.jit import device, never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.material.material import opacity
from renderer.kernel.medium.flight import left_after
from renderer.kernel.medium.medium_stack import coefficients, crossed
from renderer.kernel.steps.depths import is_layer, layers_left
from renderer.kernel.surface.surface import surface_at

__all__ = ["left_between", "light_left", "transmittance"]

_ONE = np.float32(1.0)
_ZERO = np.float32(0.0)
_BLACK = (_ZERO, _ZERO, _ZERO)


@device
def _towards(start, end):
    """Returns (unit direction, distance) from one point to another; NaN, which hits nothing, where they coincide."""
    way = vec.sub(end, start)
    distance = math.sqrt(vec.dot(way, way))
    return vec.scale(way, _ONE / distance), distance


@subroutine
def _through(scene, stack, start, end, layers, time):
    """Returns the product of the surfaces' transparencies, 1 - alpha, between the two points; 0 beyond that many layers."""
    never_inline()
    left = _ONE
    d, distance = _towards(start, end)
    after = FROM_ORIGIN
    while True:
        hit = closest_hit(scene.bvh, stack, start, d, distance, time, shadow_root(scene.bvh), after)
        if hit.primitive == NO_PRIMITIVE:
            return left
        surface = surface_at(scene, start, d, hit)
        left *= _ONE - opacity(scene, surface.material, surface.uv, surface.uv1, surface.color[3], time)
        if is_layer(scene, surface.material):
            layers -= _ONE
        if not left > _ZERO or layers < _ZERO:
            return _ZERO
        after = hit.t, hit.instance, hit.primitive


@subroutine
def light_left(scene, stack, start, end, medium_stack, layers, time):
    """Returns the transmittance, rgb 0 ... 1, between two points, through transparent surfaces and media.

    medium_stack: media that contain the first point (kernel/medium/medium_stack.py); layers, time: as for `transmittance`.
    """
    never_inline()
    left = (_ONE, _ONE, _ONE)
    d, distance = _towards(start, end)
    after = FROM_ORIGIN
    while True:
        hit = closest_hit(scene.bvh, stack, start, d, distance, time, shadow_root(scene.bvh), after)
        sigma_t, _, _ = coefficients(scene, medium_stack)
        left = vec.mul(left, left_after(sigma_t, hit.t - after[0]))
        if hit.primitive == NO_PRIMITIVE:
            return left
        surface = surface_at(scene, start, d, hit)
        faint = _ONE - opacity(scene, surface.material, surface.uv, surface.uv1, surface.color[3], time)
        left = vec.scale(left, faint)
        if is_layer(scene, surface.material):
            layers -= _ONE
        if not vec.maximum(left) > _ZERO or layers < _ZERO:
            return _BLACK
        medium_stack = crossed(scene, medium_stack, surface.material, surface.front)
        after = hit.t, hit.instance, hit.primitive


@device
def transmittance(scene, stack, start, end, transparent, layers, time=None):
    """Returns the fraction of light, 0 ... 1, that passes from `start` to `end` in a straight line.

    transparent: whether any material in the scene is transparent by its alpha; if not, a single shadow ray is traced.
    layers: number of such surfaces that the light passes at most, float32; infinite: no limit. time: as for `closest_hit`.
    """
    if scene.has.textures is not None and transparent:
        return _through(scene, stack, start, end, layers, time)
    way = vec.sub(end, start)
    return _ZERO if any_hit(scene.bvh, stack, start, way, _ONE, time, shadow_root(scene.bvh)) else _ONE


@device
def left_between(scene, stack, shadow, counts, options, time):
    """Returns the transmittance, rgb, of a ShadowRay. counts: of the path's Crossings; time: shutter time."""
    layers = layers_left(counts, options)
    if scene.has.media is not None:
        return light_left(scene, stack, shadow.start, shadow.end, shadow.medium_stack, layers, time)
    share = transmittance(scene, stack, shadow.start, shadow.end, options.transparent, layers, time)
    return share, share, share
