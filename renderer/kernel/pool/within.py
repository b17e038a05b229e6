"""Stage 2b, for scenes with media: subsurface walks of paths that hit a body with an interior.

Each path walks by itself, and leaves at a diffuse vertex, which the following stages process.
"""

from __future__ import annotations

import numpy as np

from renderer.arrays.rows import DIFFUSE as _LAMBERT
from renderer.arrays.rows import LAYER_SLOTS
from renderer.bvh.simd import load_int, store_int
from renderer.jit import device, local_floats, out_of_line, subroutine
from renderer.kernel import vec
from renderer.kernel.material.material import look_up_layers
from renderer.kernel.medium.subsurface import go_within
from renderer.kernel.pool.lists import DIFFUSE, DONE, LIT, RARE, WITHIN, append, length, row
from renderer.kernel.pool.rows import AXES, CARRIED, FRAME, HIT, MAPPED, MATTER, PLACE, RAY, SAMPLE, SHADOW, at, time_of
from renderer.kernel.pool.ways import three
from renderer.kernel.sampling.sampler import Stream
from renderer.kernel.surface.surface import NO_LIGHT, Surface
from renderer.wide.values import u32

__all__ = ["scatter_within"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_BLACK = (_ZERO, _ZERO, _ZERO)
_WHITE = (_ONE, _ONE, _ONE)
_NO_COLOR = (_ONE, _ONE, _ONE, _ONE)
_NO_TANGENT = (_ZERO, _ZERO, _ZERO, _ZERO)
_1, _2, _3, _4, _5, _6, _7 = (np.uintp(k) for k in range(1, 8))
_DIFFUSE, _RARE = np.uintp(DIFFUSE), np.uintp(RARE)


@device
def _put3(pool, place, vector):
    pool[place] = vector[0]
    pool[place + _1] = vector[1]
    pool[place + _2] = vector[2]


@device
def _surface(pool, path):
    """Returns the surface that a row has hit, with the fields that the walk needs."""
    told = pool[path + PLACE + _7]
    front = (told == _ONE) | (told == _ONE + _TWO)
    uv = pool[path + MATTER + _6], pool[path + MATTER + _7]
    uv1 = pool[path + AXES + _6], pool[path + AXES + _7]
    return Surface(
        three(pool, path + PLACE),
        pool[path + PLACE + _3],
        three(pool, path + PLACE + _4),
        three(pool, path + FRAME),
        uv,
        front,
        u32(load_int(pool, path + FRAME + _6)),
        NO_LIGHT,
        u32(load_int(pool, path + HIT + _6)),
        uv1,
        _NO_COLOR,
        _NO_TANGENT,
        told >= _TWO,
        three(pool, path + FRAME + _3),
    )


@device
def _keep(pool, path, surface, which):
    """Writes the exit of a row's walk: a white diffuse vertex, seen along its normal."""
    n = surface.shading
    s, t = vec.basis(n)
    _put3(pool, path + RAY + _3, vec.neg(n))
    _put3(pool, path + PLACE, surface.point)
    pool[path + PLACE + _3] = surface.error
    _put3(pool, path + PLACE + _4, surface.geometric)
    pool[path + PLACE + _7] = (_ONE if surface.front else _ZERO) + (_TWO if surface.smooth else _ZERO)
    _put3(pool, path + FRAME, n)
    _put3(pool, path + FRAME + _3, surface.lift)
    store_int(pool, path + FRAME + _6, np.int32(surface.material))
    pool[path + FRAME + _7] = np.float32(which)
    _put3(pool, path + MATTER, _WHITE)
    _put3(pool, path + AXES, s)
    _put3(pool, path + AXES + _3, t)
    _put3(pool, path + MAPPED, n)
    _put3(pool, path + MAPPED + _3, n)


@subroutine
def scatter_within(scene, alone, pool, lists, options):
    """Decides for each listed path whether it enters the surface, and lists it by its scattering model there, and for light
    sampling.
    """
    out_of_line()
    layers = local_floats(LAYER_SLOTS)
    for k in range(length(lists, WITHIN)):
        number = row(lists, WITHIN, k)
        path = at(number, np.uintp(0))
        surface, time = _surface(pool, path), time_of(scene.has.motion, pool, number)
        s, t, n = three(pool, path + AXES), three(pool, path + AXES + _3), three(pool, path + MAPPED)
        base, metallic, roughness = three(pool, path + MATTER), pool[path + MATTER + _3], pool[path + MATTER + _4]
        wo = vec.to_local(s, t, n, vec.neg(three(pool, path + RAY + _3)))
        kind = scene.material_kind[surface.material]
        if kind != _LAMBERT:
            seen = surface.shading, surface.uv, surface.uv1
            look_up_layers(scene, surface.material, base, metallic, roughness, *seen, (s, t, n), layers, time)
        key, sample = u32(load_int(pool, path + SAMPLE)), u32(load_int(pool, path + SAMPLE + _1))
        stream = Stream(options.sampler, options.seed, key, sample)
        vertices = np.uint32(pool[path + CARRIED + _7])
        throughput = three(pool, path + CARRIED + _4)
        within = go_within(scene, alone, surface, n, kind, base, layers, wo, throughput, stream, vertices, time)
        _put3(pool, path + CARRIED + _4, within.throughput)
        if vec.maximum(within.throughput) <= _ZERO:
            pool[path + SHADOW + _7] = _ZERO  # absorbed
            append(lists, DONE, number)
            continue
        into = _DIFFUSE if within.enters or kind == _LAMBERT else _RARE
        if within.enters:
            _keep(pool, path, within.surface, into)
        pool[path + FRAME + _7] = np.float32(into)
        append(lists, LIT, number)
        append(lists, into, number)
