"""Subsurface scattering by a random walk from the point of entry to the point of exit.

Chiang, Kutz & Burley, "Practical and Controllable Subsurface Scattering for Production Path Tracing" (2016): the interior is a
medium whose single scattering albedo follows from the surface's colour. The mapping is van de Hulst's approximation of the
diffuse reflectance of a half-space ("Multiple Light Scattering", 1980), solved for the albedo (d'Eon, "A Hitchhiker's Guide to
Multiple Scattering"). Light enters and leaves by Lambertian scattering.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from renderer.arrays import rows
from renderer.arrays.rows import COLUMNS
from renderer.bvh.traverse import NO_PRIMITIVE, closest_hit
from renderer.jit import device, never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.bsdf.layer_balance import base_view
from renderer.kernel.fetch import columns
from renderer.kernel.medium.flight import carried, flight_distance
from renderer.kernel.medium.henyey_greenstein import sample_henyey_greenstein
from renderer.kernel.polynomial import exp
from renderer.kernel.sampling.sampler import draw1, draw4
from renderer.kernel.sampling.warp import square_to_cosine_hemisphere
from renderer.kernel.spectrum.upsampling import coefficients_at
from renderer.kernel.surface.ray_origins import offset_ray_origin
from renderer.kernel.surface.surface import Surface, surface_at

__all__ = ["WALK_BLOCK", "SubsurfaceExit", "albedo_of", "enter_subsurface"]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_FOUR = np.float32(4.0)
_ROOT = np.int32(0)
_BLACK = (_ZERO, _ZERO, _ZERO)
# Van de Hulst: a half-space of similarity s reflects (1 - s) (1 - _A s) / (1 + _B s) of diffuse light.
_A, _B = np.float32(0.139), np.float32(1.17)
_STEPS = 1024  # limit of a walk; in a white body one in twenty-five finds no exit within it
_PI_STEPS = np.float32(math.pi * _STEPS)
_ONWARDS = 16  # steps after which the initial direction no longer matters
WALK_BLOCK = 1 << 20  # first random number block of walks, above those of flights
_BLOCKS = np.uint32(2 * _STEPS)  # for each vertex: one per step, and one per step for Russian roulette
_ROULETTE = np.uint32(_STEPS)
_LEAST = np.float32(1e-6)
_YES, _NO = np.bool_(True), np.bool_(False)


class SubsurfaceExit(NamedTuple):
    """The result of `enter_subsurface`: whether a path enters a body with subsurface scattering, and where it exits."""

    enters: bool  # else it scatters at the surface
    surface: Surface  # at the exit, seen from outside
    throughput: tuple[float, float, float]  # at the exit, or at the surface; 0 where the walk was absorbed


@device
def _albedo(color, g):
    linear = _ONE + _A + _B * color
    s = (linear - math.sqrt(linear * linear - _FOUR * _A * (_ONE - color))) * (_HALF / _A)
    s = max(s, _ZERO)
    return (_ONE - s * s) / (_ONE - g * s * s)


@device
def albedo_of(color, g):
    """Returns the single scattering albedo of the interior of a surface of that colour, rgb 0 ... 1.

    g: mean cosine of the scattering angle.
    """
    return _albedo(color[0], g), _albedo(color[1], g), _albedo(color[2], g)


@device
def _entrance(kind, share, color, m, wo):
    """Returns (the fraction of the light from wo that enters, the probability that a path enters).

    share: subsurface fraction of a diffuse material. m: as for `enter_subsurface`. The probability is proportional to the root of
    the light that may return from the interior, compared with the root of the light that stays outside, so that the layers'
    reflections get enough paths.
    """
    if kind == rows.DIFFUSE:
        return share, share
    _, _, _, _, _, _, passing, coat, sheen = base_view(m, wo)
    dielectric = (_ONE - m[rows.METALLIC]) * (_ONE - m[rows.TRANSMISSION])
    inside = dielectric * passing * coat * sheen * m[rows.SUBSURFACE]
    back, rest = math.sqrt(inside * vec.maximum(color)), math.sqrt(max(_ONE - inside, _ZERO))
    return inside, back / max(back + rest, _LEAST)


@device
def _share_in_the_end(sigma_t, sigma_s):
    return exp(-math.sqrt(_PI_STEPS * max(_ONE - sigma_s / sigma_t, _ZERO)))


@device
def _remaining_share(sigma_t, sigma_s):
    """Returns the fraction of light, rgb, that leaves the body after a walk has used up its steps without finding an exit.

    It is the light that diffusion returns from the mean depth of such walks, sqrt(pi / 3 steps) free paths. Without this light,
    white bodies would be slightly grey.
    """
    return (
        _share_in_the_end(sigma_t[0], sigma_s[0]),
        _share_in_the_end(sigma_t[1], sigma_s[1]),
        _share_in_the_end(sigma_t[2], sigma_s[2]),
    )


@subroutine
def _walk(scene, stack, surface, normal, color, throughput, stream, first, time, wavelengths):
    """Walks through a body from a surface hit from outside; returns (surface of the exit, throughput there).

    normal: about which the entering direction is sampled. color: of the body, with textures looked up. first: the number of the
    walk's first block of random numbers. Surfaces of other objects inside the body are ignored. A walk that finds no exit within
    all its steps leaves where it entered. wavelengths: of the path (kernel/spectrum); None in RGB.
    """
    never_inline()
    g = columns(scene.material, surface.material, COLUMNS, rows.SUBSURFACE_ANISOTROPY, 1)[0]
    radius = columns(scene.material, surface.material, COLUMNS, rows.SUBSURFACE_RADIUS, 3)
    radius = coefficients_at(scene, radius, wavelengths)
    least = _FOUR * surface.error  # shorter distances are below the rounding error
    sigma_t = _ONE / max(radius[0], least), _ONE / max(radius[1], least), _ONE / max(radius[2], least)
    sigma_s = vec.mul(albedo_of(color, g), sigma_t)
    entry = draw4(stream, first)
    s, t = vec.basis(normal)
    d = vec.to_world(s, t, normal, vec.neg(square_to_cosine_hemisphere((entry[0], entry[1]))))
    o = offset_ray_origin(surface, False, d)
    entry_surface, own, worth = surface, surface.object, _TWO / vec.maximum(throughput)
    for step in range(1, _STEPS):
        if step == _ONWARDS:
            # Similarity relation: isotropic scattering with sigma_s (1 - g) (Wyman, Patterson & Wilson 1989).
            evenly = vec.scale(sigma_s, _ONE - g)
            sigma_t = vec.add(vec.sub(sigma_t, sigma_s), evenly)
            sigma_s, g = evenly, _ZERO
        u = draw4(stream, np.uint32(first + np.uint32(step)))
        distance = flight_distance(sigma_t, throughput, (u[0], u[1]))
        left, so_far = distance, _ZERO
        while left > _ZERO:
            hit = closest_hit(scene.bvh, stack, o, d, left, time, _ROOT)
            if hit.primitive == NO_PRIMITIVE:
                break
            so_far += hit.t
            beyond = vec.add(o, vec.scale(d, _TWO * hit.t))
            surface = surface_at(scene, beyond, vec.neg(d), hit)  # seen from the far side of the surface
            if surface.object == own:
                return surface, carried(sigma_t, sigma_s, throughput, so_far, _NO)
            o = offset_ray_origin(surface, True, d)
            left -= hit.t
        throughput = carried(sigma_t, sigma_s, throughput, distance, _YES)
        o = vec.add(o, vec.scale(d, max(left, _ZERO)))
        chance = worth * vec.maximum(throughput)
        if chance <= _ZERO:
            return surface, _BLACK
        if chance < _ONE:
            if draw1(stream, np.uint32(first + _ROULETTE + np.uint32(step))) >= chance:
                return surface, _BLACK
            throughput = vec.scale(throughput, _ONE / chance)
        back = vec.neg(d)
        s, t = vec.basis(back)
        d = vec.to_world(s, t, back, sample_henyey_greenstein(g, (u[2], u[3])))
    return entry_surface, vec.mul(throughput, _remaining_share(sigma_t, sigma_s))


@subroutine
def enter_subsurface(scene, stack, surface, normal, kind, color, m, wo, throughput, stream, number, time, wavelengths):
    """Decides whether a path enters the body, and walks to its exit; returns a SubsurfaceExit.

    normal, wo: the shading normal, and the viewer's direction in the shading frame. kind, color: of the material. m:
    (LAYER_SLOTS,), the material's parameters if it is layered. stream: the path's random numbers. number: count of the path's
    earlier vertices. time: shutter time. wavelengths: as for `_walk`.
    """
    never_inline()
    first = np.uint32(np.uint32(WALK_BLOCK) + np.uint32(number) * _BLOCKS)
    share = columns(scene.material, surface.material, COLUMNS, rows.SUBSURFACE, 1)[0]
    inside, chance = _entrance(kind, share, color, m, wo)
    if draw4(stream, first)[2] >= chance:
        # Layered materials exclude the light that enters (kernel/material/layers.py); the diffuse model does not.
        left = _ONE if kind == rows.DIFFUSE else _ONE / (_ONE - chance)
        return SubsurfaceExit(_NO, surface, vec.scale(throughput, left))
    out, left = _walk(
        scene, stack, surface, normal, color, vec.scale(throughput, inside / chance), stream, first, time, wavelengths
    )
    return SubsurfaceExit(_YES, out, left)
