"""Visibility and transmittance between two points."""

from __future__ import annotations

import numpy as np

from renderer.bvh.traverse import FROM_ORIGIN, NO_PRIMITIVE, SHADOW_REACH, any_hit, closest_hit, shadow_root
from renderer.jit import device, never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.material.material import opacity
from renderer.kernel.medium.flight import left_after
from renderer.kernel.medium.medium_stack import coefficients, crossed
from renderer.kernel.steps.depths import is_layer, layers_left
from renderer.kernel.surface.surface import surface_at

__all__ = ["shadow_transmittance", "transmittance", "transmittance_rgb"]

_ONE = np.float32(1.0)
_ZERO = np.float32(0.0)
_BLACK = (_ZERO, _ZERO, _ZERO)
_WORLD = np.uint32(0)


@subroutine
def transmittance_rgb(scene, stack, start, end, medium_stack, layers, time):
    """Returns the transmittance, rgb 0 ... 1, between two points, through transparent surfaces and media.

    Hits have the distances of `any_hit`: with those biased towards the origin (`intersect_triangles` in renderer/bvh/packet.py) a
    light would occlude itself from far away. medium_stack: the media that contain the first point
    (kernel/medium/medium_stack.py); ignored in scenes without media. layers, time: as for `transmittance`.
    """
    never_inline()
    left = (_ONE, _ONE, _ONE)
    way = vec.sub(end, start)
    length = vec.length(way)
    after = FROM_ORIGIN
    while True:
        hit = closest_hit(scene.bvh, stack, start, way, SHADOW_REACH, time, shadow_root(scene.bvh), after, None)
        if scene.has.media is not None:
            sigma_t, _, _ = coefficients(scene, medium_stack)
            left = vec.mul(left, left_after(sigma_t, (hit.t - after[0]) * length))
        if hit.primitive == NO_PRIMITIVE:
            return left
        surface = surface_at(scene, start, way, hit)
        left = vec.scale(left, _ONE - opacity(scene, surface.material, surface.uv, surface.uv1, surface.color[3], time))
        if is_layer(scene, surface.material):
            layers -= _ONE
        if not vec.maximum(left) > _ZERO or layers < _ZERO:
            return _BLACK
        if scene.has.media is not None:
            medium_stack = crossed(scene, medium_stack, surface.material, surface.front)
        after = hit.t, hit.instance, hit.primitive


@device
def transmittance(scene, stack, start, end, transparent, layers, time=None):
    """Returns the fraction of light, 0 ... 1, that passes from `start` to `end` in a straight line.

    transparent: whether any material in the scene is transparent by its alpha; otherwise a single shadow ray is traced. layers:
    maximum number of such surfaces that light passes, float32; infinite: no limit. time: as for `closest_hit`.
    """
    if scene.has.textures is not None and transparent:
        return transmittance_rgb(scene, stack, start, end, _WORLD, layers, time)[0]
    way = vec.sub(end, start)
    return _ZERO if any_hit(scene.bvh, stack, start, way, SHADOW_REACH, time, shadow_root(scene.bvh)) else _ONE


@device
def shadow_transmittance(scene, stack, shadow, counts, options, time):
    """Returns the transmittance, rgb, along a ShadowRay. counts: the path's depth counts, from its Crossings.

    time: shutter time.
    """
    layers = layers_left(counts, options)
    if scene.has.media is not None and options.transparent:
        return transmittance_rgb(scene, stack, shadow.start, shadow.end, shadow.medium_stack, layers, time)
    share = transmittance(scene, stack, shadow.start, shadow.end, options.transparent, layers, time)
    left = share, share, share
    if scene.has.media is not None:
        sigma_t, _, _ = coefficients(scene, shadow.medium_stack)
        left = vec.scale(left_after(sigma_t, vec.length(vec.sub(shadow.end, shadow.start))), share)
    return left
