"""Visibility and transmittance between two points."""

from __future__ import annotations

import numpy as np

from renderer.bvh.traverse import FROM_ORIGIN, NO_PRIMITIVE, SHADOW_REACH, any_hit, closest_hit
from renderer.jit import device, never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.material.material import opacity
from renderer.kernel.medium.flight import left_after
from renderer.kernel.medium.medium_stack import coefficients, crossed, innermost
from renderer.kernel.medium.volume import shadow_block, volume_of, volume_transmittance
from renderer.kernel.steps.depths import is_layer, layers_left
from renderer.kernel.surface.surface import surface_at
from renderer.wide.lanes import each_lane
from renderer.wide.values import any_of, to_int, u32, where3, zero_like

__all__ = ["media_transmittance", "shadow_transmittance", "transmittance", "transmittance_rgb"]

_ONE = np.float32(1.0)
_ZERO = np.float32(0.0)
_BLACK = (_ZERO, _ZERO, _ZERO)
_WORLD = np.uint32(0)
_NO_RANDOM = (np.uint32(0), np.uint32(0), np.uint32(0), np.uint32(0))


@subroutine
def transmittance_rgb(scene, stack, start, end, medium_stack, layers, time, random, root, wavelengths):
    """Returns the transmittance, rgb 0 ... 1, between two points, through transparent surfaces and media.

    Hits have the distances of `any_hit`: with those biased towards the origin (`intersect_triangles` in renderer/bvh/packet.py) a
    light would occlude itself from far away. medium_stack: the media that contain the first point
    (kernel/medium/medium_stack.py); ignored in scenes without media. layers, time: as for `transmittance`. random: seed, pixel,
    sample and first block of the numbers for heterogeneous media. root: the node at which the shadow ray starts.
    wavelengths, in this module: of the path (kernel/spectrum); None in RGB.
    """
    never_inline()
    left = (_ONE, _ONE, _ONE)
    way = vec.sub(end, start)
    length = vec.length(way)
    seed, pixel, sample, block = random
    after = FROM_ORIGIN
    while True:
        hit = closest_hit(scene.bvh, stack, start, way, SHADOW_REACH, time, root, after, None)
        if scene.has.media is not None:
            homogeneous = True
            if scene.has.grids is not None:
                medium = innermost(medium_stack)
                homogeneous = not volume_of(scene, medium) > _ZERO
                if not homogeneous:
                    d, (sigma_t, _, _) = vec.scale(way, _ONE / length), coefficients(scene, medium_stack, wavelengths)
                    part, block = volume_transmittance(
                        scene, medium, sigma_t, start, d, after[0] * length, hit.t * length, seed, pixel, sample, block
                    )
                    left = vec.mul(left, part)
            if homogeneous:
                sigma_t, _, _ = coefficients(scene, medium_stack, wavelengths)
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
def transmittance(scene, stack, start, end, transparent, layers, time, root, wavelengths=None):
    """Returns the fraction of light, 0 ... 1, that passes from `start` to `end` in a straight line.

    transparent: whether any material in the scene is transparent by its alpha; otherwise a single shadow ray is traced. layers:
    maximum number of such surfaces that light passes, float32; infinite: no limit. time: as for `closest_hit`. root: as for
    `transmittance_rgb`.
    """
    if scene.has.textures is not None and transparent:
        return transmittance_rgb(scene, stack, start, end, _WORLD, layers, time, _NO_RANDOM, root, wavelengths)[0]
    way = vec.sub(end, start)
    return _ZERO if any_hit(scene.bvh, stack, start, way, SHADOW_REACH, time, root) else _ONE


@device
def media_transmittance(scene, medium_stack, start, end, stream, number, wavelengths):
    """Returns the transmittance, rgb, of the innermost medium between two points, for one path or for eight lanes.

    stream, number: the path's Stream and the count of vertices before the one that the shadow ray leaves.
    """
    way = vec.sub(end, start)
    length = vec.length(way)
    sigma_t, _, _ = coefficients(scene, medium_stack, wavelengths)
    left = left_after(sigma_t, length)
    if scene.has.grids is not None:
        medium = innermost(medium_stack)
        is_grid = volume_of(scene, medium) > _ZERO
        if any_of(is_grid):
            ray = medium, sigma_t, start, vec.scale(way, _ONE / length), zero_like(length), length
            random = u32(stream.seed), stream.pixel, stream.sample, shadow_block(to_int(number))
            part, _ = each_lane(volume_transmittance, is_grid, (scene, *ray, *random))
            left = where3(is_grid, part, left)
    return left


@device
def shadow_transmittance(scene, stack, shadow, counts, options, time, stream, number, root, wavelengths):
    """Returns the transmittance, rgb, along a ShadowRay. counts: the path's depth counts, from its Crossings.

    time: shutter time. stream, number: as for `media_transmittance`. root: as for `transmittance_rgb`.
    """
    layers = layers_left(counts, options)
    if scene.has.media is not None and options.transparent:
        random = u32(stream.seed), u32(stream.pixel), u32(stream.sample), shadow_block(to_int(number))
        known = shadow.start, shadow.end, shadow.medium_stack, layers, time, random, root
        return transmittance_rgb(scene, stack, *known, wavelengths)
    share = transmittance(scene, stack, shadow.start, shadow.end, options.transparent, layers, time, root, wavelengths)
    left = share, share, share
    if scene.has.media is not None:
        known = shadow.medium_stack, shadow.start, shadow.end, stream, number
        left = vec.scale(media_transmittance(scene, *known, wavelengths), share)
    return left
