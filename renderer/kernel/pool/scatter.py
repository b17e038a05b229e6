"""Stage 4: evaluates the sampled light at each vertex, and samples the path's next direction. One list of vertices at a time."""

from __future__ import annotations

from typing import Any

import numpy as np

from renderer.jit import device, out_of_line, subroutine, template
from renderer.kernel import vec
from renderer.kernel.integrators.depths import bounced
from renderer.kernel.integrators.record import AGAIN
from renderer.kernel.integrators.roulette import IN_MEDIA, ON_SURFACES, survival, worth_after
from renderer.kernel.integrators.splitting import beside, of_branch, turned
from renderer.kernel.integrators.state import MAX_AGAIN, is_counted
from renderer.kernel.integrators.strategy import power_heuristic
from renderer.kernel.medium.medium_stack import crossed
from renderer.kernel.pool.lists import (
    ACTIVE,
    CONDUCTOR,
    DIFFUSE,
    DRIFTING,
    METALLIC_ROUGHNESS,
    NODES,
    RARE,
    RARE_SPECULAR,
    SPECULAR,
    append,
    cut,
    eight,
    length,
    pad,
    put,
    row,
)
from renderer.kernel.pool.models import (
    Matter,
    answer_conductor,
    answer_diffuse,
    answer_in_medium,
    answer_metallic_roughness,
    answer_rare,
    answer_specular,
)
from renderer.kernel.pool.rows import (
    AXES,
    BRANCHES,
    CARRIED,
    COUNTS,
    FRAME,
    HIT,
    LAMP,
    MAPPED,
    MATTER,
    NEST,
    PATHS,
    PLACE,
    RAY,
    SAMPLE,
    SHADOW,
    at,
    few,
    read,
    times_of,
    write,
)
from renderer.kernel.sampling.sampler import Stream, draw4
from renderer.kernel.surface.ray_origins import departure, leaves
from renderer.kernel.surface.surface import NO_LIGHT, Surface
from renderer.wide.values import as_floats, as_ints, nil, to_int, where

__all__ = ["kinds_of_scattering", "scatter", "stream_of"]

_DIFFUSE, _SPECULAR, _METALLIC_ROUGHNESS, _CONDUCTOR, _RARE = (
    np.uintp(which) for which in (DIFFUSE, SPECULAR, METALLIC_ROUGHNESS, CONDUCTOR, RARE)
)
_RARE_SPECULAR = np.float32(RARE_SPECULAR)
_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_MOST_AGAIN = np.float32(MAX_AGAIN)
_AGAIN = np.float32(AGAIN)
_BLOCK = np.uint32(2)
_NUMBER = CARRIED + np.uintp(7)
_WHICH = FRAME + np.uintp(7)
_END, _GOES_ON = SHADOW + np.uintp(3), SHADOW + np.uintp(7)
_PATHS, _SECOND = np.uintp(PATHS), np.uint32(PATHS)
_NO_UV = (_ZERO, _ZERO)
_WHITE = (_ONE, _ONE, _ONE, _ONE)
_NO_TANGENT = (_ZERO, _ZERO, _ZERO, _ZERO)


@device
def stream_of(pool, rows, options):
    """Returns the random number streams of eight rows' samples."""
    key, sample = few(pool, rows, SAMPLE, 2)
    return Stream(options.sampler, options.seed, as_ints(key), as_ints(sample))


@device
def _surface(place, frame):
    """Returns the surface, with the fields that scattering needs, from the groups of its rows."""
    front = (place[7] == _ONE) | (place[7] == _ONE + _TWO)
    return Surface(
        (place[0], place[1], place[2]),
        place[3],
        (place[4], place[5], place[6]),
        (frame[0], frame[1], frame[2]),
        _NO_UV,
        front,
        as_ints(frame[6]),
        NO_LIGHT,
        NO_LIGHT,
        _NO_UV,
        _WHITE,
        _NO_TANGENT,
        place[7] >= _TWO,
        (frame[3], frame[4], frame[5]),
    )


@device
def _matter(scene, pool, rows, surface):
    """Returns the vertices' materials, as far as they have been looked up."""
    n, none = surface.shading, nil(surface.error)
    s, t = vec.basis(n)
    base, metallic, roughness, eta, uv, uv1 = (none, none, none), none, none, none, (none, none), (none, none)
    if scene.has.textures is not None:
        matter, axes, mapped = read(pool, rows, MATTER), read(pool, rows, AXES), read(pool, rows, MAPPED)
        base, metallic, roughness, eta = (matter[0], matter[1], matter[2]), matter[3], matter[4], matter[5]
        uv, uv1 = (matter[6], matter[7]), (axes[6], axes[7])
        s, t, n = (axes[0], axes[1], axes[2]), (axes[3], axes[4], axes[5]), (mapped[0], mapped[1], mapped[2])
    time = times_of(scene.has.motion, pool, rows)
    return Matter(surface.material, surface.front, base, metallic, roughness, eta, uv, uv1, surface.shading, (s, t, n), time)


@device
def _splits(number, which):
    """Whether a path splits at its vertex. number: count of earlier vertices.

    Which: the vertex's list. For one or eight lanes.
    """
    return (number == _ZERO) & (which != _RARE_SPECULAR)


@device
def _splitting(pool, lists, which):
    """Lists the rows of a list that split at their vertex; returns that list, one that is free at this stage."""
    count = np.uintp(0)
    for k in range(length(lists, which)):
        path = row(lists, which, k)
        put(lists, NODES, count, path)
        count += np.uintp(_splits(pool[at(path, _NUMBER)], pool[at(path, _WHICH)]))
    cut(lists, NODES, count)
    return NODES


@device
def _keep_vertices(scene, pool, rows, stream, place, frame):
    """Copies the vertices to the rows of second branches, with random numbers of their own."""
    others = rows + _SECOND
    told = read(pool, rows, SAMPLE)
    write(pool, others, SAMPLE, (as_floats(beside(stream).pixel), *told[1:]))
    write(pool, others, HIT, read(pool, rows, HIT))
    write(pool, others, PLACE, place)
    write(pool, others, FRAME, frame)
    if scene.has.textures is not None:
        write(pool, others, MAPPED, read(pool, rows, MAPPED))


@device
def _list_branches(pool, lists, which):
    """Adds the second branches of a list's rows to the active list, if they continue."""
    for k in range(length(lists, which)):
        path = row(lists, which, k)
        if not (pool[at(path + _PATHS, _GOES_ON)] <= _ZERO):  # NaN propagates, so the film can count it
            pool[at(path, BRANCHES)] = _TWO
            append(lists, ACTIVE, path + _PATHS)


@template
def _scatter(scene, pool, lists, which, answer, is_lit, is_surface, options, lit, second):
    """Scatters the vertices on one list, see `scatter`.

    answer: from models.py; is_lit: None where light sampling finds nothing; is_surface: None in a medium; lit, second: as in
    `scatter`.
    """
    taken = _splitting(pool, lists, which) if second else which
    for k in range(0, pad(lists, taken), 8):
        rows = eight(lists, taken, k)
        ray, lamp = read(pool, rows, RAY), read(pool, rows, LAMP)
        rx, ry, rz, depth, tx, ty, tz, number = read(pool, rows, CARRIED)
        place, frame = read(pool, rows, PLACE), read(pool, rows, FRAME)
        surface = _surface(place, frame)
        m = _matter(scene, pool, rows, surface)
        s, t, n = m.frame
        throughput, none = (tx, ty, tz), nil(depth)
        if scene.has.media is not None:
            nest = as_ints(few(pool, rows, NEST, 1)[0])
            through = nest
            if is_surface is not None:
                through = crossed(scene, nest, surface.material, surface.front)
        wo = vec.to_local(s, t, n, (-ray[3], -ray[4], -ray[5]))
        towards, light_pdf, light = (lamp[0], lamp[1], lamp[2]), lamp[3], (lamp[4], lamp[5], lamp[6])
        wi = vec.to_local(s, t, n, towards)
        if second or not lit:
            wi = wo  # there is no light: any direction
        stream = stream_of(pool, rows, options)
        u = draw4(stream, to_int(number) * _BLOCK + _BLOCK)
        if second:
            u = turned(u)
        f, scatter_pdf, on, weight, pdf, eta2 = answer(scene, m, wo, wi, u[2], (u[0], u[1]))
        whole_pdf = pdf
        if is_lit is not None:
            branches = where(_splits(number, frame[7]), none + np.float32(options.splitting), _ONE)
            weight, pdf = of_branch(weight, pdf, branches)
        d = vec.to_world(s, t, n, on)
        reflected = on[2] > _ZERO
        o = departure(surface, reflected, d)
        start, end, waits = (none, none, none), (none, none, none), none
        if is_lit is not None and lit and not second:
            balance = where(lamp[7] == _ZERO, _ONE, power_heuristic(light_pdf, lamp[7] * scatter_pdf))
            brought = vec.mul(throughput, vec.scale(vec.mul(f, light), balance / light_pdf))
            start, end = departure(surface, wi[2] > _ZERO, towards), few(pool, rows, _END, 3)
            seen = (light_pdf > _ZERO) & (vec.maximum(light) > _ZERO) & (vec.maximum(f) > _ZERO)
            waits = where(seen, _ONE, none)
            begins_in = none
            if scene.has.media is not None:
                begins_in = as_floats(where(wi[2] > _ZERO, nest, through))
            write(pool, rows, LAMP, (*brought, depth + _TWO, balance, light_pdf, begins_in, none))

        has_left = leaves(surface, reflected, d)
        depth = where(is_counted(has_left, reflected, pdf, options), depth + _ONE, depth)
        counts = none, none, none, none
        if options.has_depths:
            counts = few(pool, rows, COUNTS, 4)
            if is_surface is not None:
                counts = bounced(counts, has_left, reflected, whole_pdf)
        throughput = vec.mul(throughput, weight)
        worth = worth_after(ray[7], number, weight, eta2)
        chance = survival(throughput, worth, depth, options, ON_SURFACES if is_surface is not None else IN_MEDIA)
        # A NaN throughput propagates, so the film can count it.
        goes_on = where(u[3] >= chance, -chance, chance)
        goes_on = where(number + _ONE - depth > _MOST_AGAIN + np.float32(options.transmission_depth), _AGAIN, goes_on)
        goes_on = where(vec.maximum(throughput) <= _ZERO, none, goes_on)
        throughput = vec.scale(throughput, _ONE / chance)
        if second:
            _keep_vertices(scene, pool, rows, stream, place, frame)
            rows = rows + _SECOND
            rx = ry = rz = none
        if scene.has.media is not None:
            goes_in = as_floats(where(reflected, nest, through))
            write(pool, rows, NEST, (goes_in, *counts, none, none, none))
        elif options.has_depths:
            write(pool, rows, NEST, (none, *counts, none, none, none))
        write(pool, rows, RAY, (*o, *d, pdf, worth))
        write(pool, rows, CARRIED, (rx, ry, rz, depth, *throughput, number + _ONE))
        write(pool, rows, SHADOW, (*start, *end, waits, goes_on))
    if second:
        _list_branches(pool, lists, taken)


@subroutine
def _scatter_diffuse(scene, pool, lists, options, lit, second):
    out_of_line()
    _scatter(scene, pool, lists, _DIFFUSE, answer_diffuse, True, True, options, lit, second)


@subroutine
def _scatter_specular(scene, pool, lists, options, lit, second):
    out_of_line()
    _scatter(scene, pool, lists, _SPECULAR, answer_specular, None, True, options, lit, False)


@subroutine
def _scatter_metallic_roughness(scene, pool, lists, options, lit, second):
    out_of_line()
    _scatter(scene, pool, lists, _METALLIC_ROUGHNESS, answer_metallic_roughness, True, True, options, lit, second)


@subroutine
def _scatter_conductor(scene, pool, lists, options, lit, second):
    out_of_line()
    _scatter(scene, pool, lists, _CONDUCTOR, answer_conductor, True, True, options, lit, second)


@subroutine
def _scatter_rare(scene, pool, lists, options, lit, second):
    out_of_line()
    _scatter(scene, pool, lists, _RARE, answer_rare, True, True, options, lit, second)


@subroutine
def _scatter_in_medium(scene, pool, lists, options, lit, second):
    out_of_line()
    _scatter(scene, pool, lists, DRIFTING, answer_in_medium, True, None, options, lit, second)


@subroutine
def scatter(scene, pool, lists, options, lit, second):
    """Scatters all listed vertices: writes the path's next ray, and the shadow ray towards the sampled light.

    lit: whether light sampling can find anything in the scene. second: whether to start only the second branches of splitting
    paths (integrators/splitting.py), without scattering the others.
    """
    out_of_line()
    if scene.has.layers is not None and length(lists, _RARE) > 0:
        _scatter_rare(scene, pool, lists, options, lit, second)
    if scene.has.media is not None and length(lists, DRIFTING) > 0:
        _scatter_in_medium(scene, pool, lists, options, lit, second)
    if length(lists, _DIFFUSE) > 0:
        _scatter_diffuse(scene, pool, lists, options, lit, second)
    if length(lists, _SPECULAR) > 0 and not second:
        _scatter_specular(scene, pool, lists, options, lit, second)
    if length(lists, _METALLIC_ROUGHNESS) > 0:
        _scatter_metallic_roughness(scene, pool, lists, options, lit, second)
    if length(lists, _CONDUCTOR) > 0:
        _scatter_conductor(scene, pool, lists, options, lit, second)


def kinds_of_scattering(has: Any) -> list[Any]:
    """Returns the functions that `scatter` calls for scenes with these features; the slowest to compile first."""
    rare = [_scatter_rare] if has.layers is not None else []
    in_medium = [_scatter_in_medium] if has.media is not None else []
    return [*rare, *in_medium, _scatter_metallic_roughness, _scatter_conductor, _scatter_specular, _scatter_diffuse]
