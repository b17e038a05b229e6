"""Passing through surfaces (transparent ones, boundaries of media, lamps without a body), and absorption between surfaces."""

from __future__ import annotations

import math

import numpy as np

from renderer.arrays.rows import ABSORBING, ABSORPTION, COLUMNS, LAMP, TRANSPARENT
from renderer.jit import device, never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.fetch import columns
from renderer.kernel.material.material import has_flag, opacity
from renderer.kernel.medium.medium_stack import crossed
from renderer.kernel.polynomial import exp
from renderer.kernel.spectrum.upsampling import coefficients_at
from renderer.kernel.steps.depths import is_blocked, with_layer
from renderer.kernel.steps.random_blocks import draw_passing
from renderer.kernel.steps.state import Crossings
from renderer.wide.values import any_of, not_, where, where3, zero_like

__all__ = ["absorb", "absorbed", "counts_emission", "is_passed", "pass_through"]

_ZERO = np.float32(0.0)
_LAMP, _TRANSPARENT, _ABSORBING = np.uint32(LAMP), np.uint32(TRANSPARENT), np.uint32(ABSORBING)


@device
def is_passed(scene, surface, stream, row, options, time):
    """Returns True if the ray passes the surface that it hits: at random by alpha, or because it is a lamp without a body.

    row: number of surfaces hit before, passed or not, a float. time: shutter time, 0 to 1; None in a scene without motion.
    """
    through = surface.error != surface.error
    if scene.has.textures is not None:
        through = has_flag(scene, surface.material, _LAMP)
        if options.transparent:
            may = has_flag(scene, surface.material, _TRANSPARENT)
            if any_of(may):
                u = draw_passing(stream, row)
                faint = u >= opacity(scene, surface.material, surface.uv, surface.uv1, surface.color[3], time)
                through = through | (may & faint)
    return through


@device
def counts_emission(scene, surface, through):
    """Returns True if the surface's emission is added: if the path does not pass through it, or it is a lamp without a body."""
    counts = not_(through)
    if scene.has.textures is not None:
        counts = counts | has_flag(scene, surface.material, _LAMP)
    return counts


@subroutine
def absorbed(throughput, a, start, end):
    """Returns the throughput after absorption between two points: Beer's law. a: absorption coefficient, rgb per unit length."""
    never_inline()
    way = vec.sub(end, start)
    distance = math.sqrt(vec.dot(way, way))
    return throughput[0] * exp(-a[0] * distance), throughput[1] * exp(-a[1] * distance), throughput[2] * exp(-a[2] * distance)


@device
def absorb(scene, surface, through, throughput, start, wavelengths):
    """Returns the throughput at the surface, after absorption in its material since the last vertex, `start`.

    In a scene with media nothing is absorbed here, since the free flights include the absorption. wavelengths: of the path
    (kernel/spectrum); None in RGB.
    """
    if scene.has.layers is not None and scene.has.media is None:
        inside = not_(surface.front | through) & has_flag(scene, surface.material, _ABSORBING)
        if any_of(inside):
            taken = coefficients_at(scene, columns(scene.material, surface.material, COLUMNS, ABSORPTION, 3), wavelengths)
            throughput = where3(inside, absorbed(throughput, taken, start, surface.point), throughput)
    return throughput


@device
def pass_through(scene, surface, through, crossings, options):
    """Returns (Crossings beyond the surface; mask of paths that have reached the limit on surfaces with alpha).

    The Crossings change only where `through` is True: where the path passes through the surface.
    """
    diffuse, glossy, transmitted, layers = crossings.counts
    layers = where(through, with_layer(scene, surface.material, crossings.counts)[3], layers)
    medium_stack = crossings.medium_stack
    if scene.has.media is not None:
        medium_stack = where(through, crossed(scene, medium_stack, surface.material, surface.front), medium_stack)
    beyond = Crossings(medium_stack, (diffuse, glossy, transmitted, layers), zero_like(layers), crossings.ray_kind)
    return beyond, is_blocked(scene, surface.material, crossings.counts, options)
