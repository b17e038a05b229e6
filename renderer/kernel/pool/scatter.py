"""Stage 4: a vertex scatters: what its light sends on to the viewer, and the ray that the path goes on by. A list at a time."""

from __future__ import annotations

import numpy as np

from renderer.arrays.rows import CONDUCTOR, DIFFUSE, GLASS, METALLIC_ROUGHNESS, MIRROR
from renderer.jit import device, out_of_line, subroutine, template
from renderer.kernel import vec
from renderer.kernel.integrators.state import MAX_AGAIN
from renderer.kernel.integrators.strategy import power_heuristic
from renderer.kernel.integrators.transport import limited
from renderer.kernel.pool.lists import SMOOTH_CONDUCTOR, eight, length, pad
from renderer.kernel.pool.models import (
    evaluate_conductor,
    evaluate_diffuse,
    evaluate_metallic_roughness,
    fetch_base,
    fetch_conductor,
    fetch_glass,
    fetch_metallic_roughness,
    scatter_conductor,
    scatter_diffuse,
    scatter_glass,
    scatter_metallic_roughness,
    scatter_mirror,
    scatter_smooth_conductor,
)
from renderer.kernel.pool.rows import CARRIED, FACTS, FRAME, LAMP, LAST, PLACE, RAY, SHADOW, read, write
from renderer.kernel.sampling.sampler import Stream, draw4
from renderer.kernel.surface.surface import Surface, departure, leaves
from renderer.settings import MAX_FLOOR
from renderer.wide.values import as_ints, nil, to_int, where

__all__ = ["scatter", "stream_of"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_ROULETTE_FROM = np.float32(4.0)
_MOST_SURVIVAL = np.float32(MAX_FLOOR)
_MOST_AGAIN = np.float32(MAX_AGAIN)
_BLOCK = np.uint32(2)
_NO_UV = (_ZERO, _ZERO)
_WHITE = (_ONE, _ONE, _ONE, _ONE)
_NO_TANGENT = (_ZERO, _ZERO, _ZERO, _ZERO)


@device
def stream_of(facts, options):
    """The numbers of eight samples, from the group FACTS of their rows."""
    return Stream(options.sampler, options.seed, as_ints(facts[2]), as_ints(facts[3]))


@device
def _surface(facts, place, frame):
    """The surface, as far as scattering asks for it, from the groups of its rows."""
    front = (place[7] == _ONE) | (place[7] == _ONE + _TWO)
    return Surface(
        (place[0], place[1], place[2]),
        place[3],
        (place[4], place[5], place[6]),
        (frame[0], frame[1], frame[2]),
        _NO_UV,
        front,
        as_ints(facts[5]),
        as_ints(facts[6]),
        as_ints(facts[7]),
        _NO_UV,
        _WHITE,
        _NO_TANGENT,
        place[7] >= _TWO,
        (frame[3], frame[4], frame[5]),
    )


@device
def _survival(throughput, eta_scale, depth, options):
    """Russian roulette: the probability that a path goes on."""
    by_throughput = min(max(vec.maximum(throughput) * eta_scale, options.roulette_floor), _MOST_SURVIVAL)
    chance = where(depth < _ROULETTE_FROM, _ONE, by_throughput)
    return where(options.roulette > _ZERO, options.roulette, chance)


@template
def _direct(pool, rows, surface, basis, m, wo, evaluate, throughput, depth, options):
    """Makes the shadow rays ready: next-event estimation with the points of lights that lamps.py chose."""
    lamp, shadow = read(pool, rows, LAMP), read(pool, rows, SHADOW)
    w, pdf, light, none = (lamp[0], lamp[1], lamp[2]), lamp[3], (lamp[4], lamp[5], lamp[6]), nil(depth)
    wi = vec.to_local(basis[0], basis[1], surface.shading, w)
    f, scatter_pdf = evaluate(m, wo, wi)
    weight = where(lamp[7] != _ZERO, _ONE, power_heuristic(pdf, scatter_pdf)) / pdf
    brought = vec.mul(throughput, vec.scale(vec.mul(f, light), weight))
    brought = limited(brought, depth + _TWO, options.clamp)
    waits = (pdf > _ZERO) & (vec.maximum(light) > _ZERO) & (vec.maximum(f) > _ZERO)
    start = departure(surface, wi[2] > _ZERO, w)
    write(pool, rows, LAMP, (*brought, none, none, none, none, none))
    return start, (shadow[3], shadow[4], shadow[5]), where(waits, _ONE, none)


@template
def _scatter(scene, pool, lists, which, fetch, evaluate, sample, both_sides, options, lit):
    """evaluate: None where light sampling finds nothing; both_sides: True where a vertex is lit from both, else None.

    lit: whether there is anything that light sampling would find in the scene.
    """
    for k in range(0, pad(lists, which), 8):
        rows = eight(lists, which, k)
        ray, facts = read(pool, rows, RAY), read(pool, rows, FACTS)
        rx, ry, rz, depth, tx, ty, tz, number = read(pool, rows, CARRIED)
        surface = _surface(facts, read(pool, rows, PLACE), read(pool, rows, FRAME))
        n, throughput = surface.shading, (tx, ty, tz)
        s, t = vec.basis(n)
        wo = vec.to_local(s, t, n, (-ray[3], -ray[4], -ray[5]))
        m = fetch(scene, surface.material, surface.front)
        none = nil(depth)
        start, end, waits = (none, none, none), (none, none, none), none
        if evaluate is not None and lit:
            start, end, waits = _direct(pool, rows, surface, (s, t), m, wo, evaluate, throughput, depth, options)

        u = draw4(stream_of(facts, options), to_int(number) * _BLOCK + _BLOCK)
        wi, weight, pdf, eta2 = sample(m, wo, u[2], (u[0], u[1]))
        d = vec.to_world(s, t, n, wi)
        reflected = wi[2] > _ZERO
        o = departure(surface, reflected, d)
        depth = where(leaves(surface, reflected, d), depth + _ONE, depth)
        throughput = vec.mul(throughput, weight)
        eta_scale = ray[7] * eta2
        survival = _survival(throughput, eta_scale, depth, options)
        alive = (vec.maximum(throughput) > _ZERO) & (u[3] < survival) & (number + _ONE - depth <= _MOST_AGAIN)
        throughput = vec.scale(throughput, _ONE / survival)
        if both_sides is not None:
            n = none, none, none
        write(pool, rows, RAY, (*o, *d, pdf, eta_scale))
        write(pool, rows, CARRIED, (rx, ry, rz, depth, *throughput, number + _ONE))
        write(pool, rows, LAST, (*surface.point, *n, none, none))
        write(pool, rows, SHADOW, (*start, *end, waits, where(alive, _ONE, none)))


@subroutine
def _scatter_diffuse(scene, pool, lists, options, lit):
    out_of_line()
    _scatter(scene, pool, lists, DIFFUSE, fetch_base, evaluate_diffuse, scatter_diffuse, None, options, lit)


@subroutine
def _scatter_mirror(scene, pool, lists, options, lit):
    out_of_line()
    _scatter(scene, pool, lists, MIRROR, fetch_base, None, scatter_mirror, None, options, lit)


@subroutine
def _scatter_glass(scene, pool, lists, options, lit):
    out_of_line()
    _scatter(scene, pool, lists, GLASS, fetch_glass, None, scatter_glass, True, options, lit)


@subroutine
def _scatter_metallic_roughness(scene, pool, lists, options, lit):
    out_of_line()
    _scatter(
        scene,
        pool,
        lists,
        METALLIC_ROUGHNESS,
        fetch_metallic_roughness,
        evaluate_metallic_roughness,
        scatter_metallic_roughness,
        None,
        options,
        lit,
    )


@subroutine
def _scatter_conductor(scene, pool, lists, options, lit):
    out_of_line()
    _scatter(scene, pool, lists, CONDUCTOR, fetch_conductor, evaluate_conductor, scatter_conductor, None, options, lit)


@subroutine
def _scatter_smooth_conductor(scene, pool, lists, options, lit):
    out_of_line()
    _scatter(scene, pool, lists, SMOOTH_CONDUCTOR, fetch_conductor, None, scatter_smooth_conductor, None, options, lit)


@subroutine
def scatter(scene, pool, lists, options, lit):
    """Scatters every listed vertex: writes the path's next ray, and the shadow ray towards its light."""
    out_of_line()
    if length(lists, DIFFUSE) > 0:
        _scatter_diffuse(scene, pool, lists, options, lit)
    if length(lists, MIRROR) > 0:
        _scatter_mirror(scene, pool, lists, options, lit)
    if length(lists, GLASS) > 0:
        _scatter_glass(scene, pool, lists, options, lit)
    if length(lists, METALLIC_ROUGHNESS) > 0:
        _scatter_metallic_roughness(scene, pool, lists, options, lit)
    if length(lists, CONDUCTOR) > 0:
        _scatter_conductor(scene, pool, lists, options, lit)
    if length(lists, SMOOTH_CONDUCTOR) > 0:
        _scatter_smooth_conductor(scene, pool, lists, options, lit)
