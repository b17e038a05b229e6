"""Samples a light for each vertex at which light sampling can contribute.

With a light tree, all vertices descend the tree together, one level at a time. The choice at a level consists of a few long sums
and roots, which the processor can overlap between vertices.
"""

from __future__ import annotations

import numpy as np

from renderer.arrays.light_rows import LIGHT_ROWS, LIGHT_WIDTH
from renderer.bvh.simd import store_int
from renderer.jit import device, never_inline, subroutine, template
from renderer.kernel.backends.cpu.lists import LIT, NODES, eight_rows, pad, put, row
from renderer.kernel.backends.cpu.rows import (
    ChosenLight,
    LightDescent,
    Outcome,
    Shading,
    at,
    column,
    gather,
    group_row,
    last_vertex,
    path_wavelengths,
    scatter,
    streams_of,
    time_of,
)
from renderer.kernel.backends.cpu.traversal_state import load_index
from renderer.kernel.light.light_sample import light_sample_at
from renderer.kernel.light.light_tree import descend
from renderer.kernel.light.lights import choose_by_power, nearby_choice, sample_chosen
from renderer.kernel.light.links import linked_sample
from renderer.kernel.light.visibility import sampled_visibility, with_visibility
from renderer.kernel.light_groups import ChosenGroup, group_of_sample, scatter_group
from renderer.kernel.steps.catch_reflections import branches_at_catcher, catches_reflections
from renderer.kernel.steps.mis import branches_to_light
from renderer.kernel.steps.random_blocks import draw_light
from renderer.kernel.steps.record_first_hit import FirstHit
from renderer.kernel.steps.state import PathState
from renderer.wide.values import as_wide, to_float, u32, where, zero_like

__all__ = ["choose_light", "choose_lights", "numbers_for_light"]

_ZERO, _ONE = np.float32(0.0), np.float32(1.0)
_ROOT = np.uint32(0)
_NODE = np.uintp(LIGHT_ROWS * LIGHT_WIDTH)
_LEFT, _CHANCE, _HERE = (column(LightDescent, field) for field in ("left", "chance", "here"))


@device
def numbers_for_light(pool, rows, options):
    """Returns the random numbers with which one path or eight sample lights: two for the point on a light, one to choose it."""
    u = draw_light(streams_of(pool, rows, options), gather(pool, rows, PathState).number)
    return u[0], u[1], u[2]


@subroutine
def _descend(scene, pool, lists, options):
    """Chooses a light for each vertex on the list LIT by descending the light tree.

    Writes LightDescent to the vertex's row of the pool.
    """
    never_inline()
    waiting = np.uintp(pad(lists, LIT))
    for k in range(0, np.int64(waiting), 8):
        rows = eight_rows(lists, LIT, k)
        u, v, choice = numbers_for_light(pool, rows, options)
        _, left = nearby_choice(scene, choice)
        scatter(pool, rows, LightDescent(left, zero_like(left) + _ONE, as_wide(_ROOT, left), u, v, choice))
    for k in range(np.int64(waiting)):
        put(lists, NODES, np.uintp(k), row(lists, LIT, k))
    while waiting > np.uintp(0):
        count, waiting = waiting, np.uintp(0)
        for k in range(np.int64(count)):
            number = row(lists, NODES, k)
            path = at(number, np.uintp(0))
            base = load_index(pool, path + _HERE) * _NODE
            vertex = last_vertex(scene, pool, number)
            child, share, left = descend(scene.light_node, base, vertex.point, vertex.normal, pool[path + _LEFT])
            pool[path + _LEFT] = left
            pool[path + _CHANCE] *= share
            store_int(pool, path + _HERE, child)
            put(lists, NODES, waiting, number)
            waiting += np.uintp(child >= np.int32(0))


@device
def _store_group(scene, pool, rows, options, choice, light):
    """Writes the light group of what eight paths have sampled behind the light by group of their rows."""
    scatter_group(pool, group_row(pool, rows, options) + options.groups, ChosenGroup(group_of_sample(scene, choice, u32(light))))


@template
def choose_light(scene, pool, rows, by_tree, options):
    """Samples a light for the vertices in one row of the pool or in eight; writes ChosenLight and Outcome.

    by_tree: whether the rows' LightDescent has the light that each has chosen by the light tree.
    """
    vertex, time = last_vertex(scene, pool, rows), time_of(scene.has.motion, pool, rows)
    if scene.has.lights is not None and by_tree:
        way = gather(pool, rows, LightDescent)
        which, chosen = way.choice, way.here ^ np.uint32(0xFFFFFFFF)
        light = sample_chosen(scene, vertex.point, vertex.normal, which, (way.u, way.v), chosen, way.chance, time)
        if scene.has.groups is not None:
            _store_group(scene, pool, rows, options, which, chosen)
    else:
        u, v, which = numbers_for_light(pool, rows, options)
        chosen, chance = choose_by_power(scene, which)
        light = sample_chosen(scene, vertex.point, vertex.normal, which, (u, v), chosen, chance, time)
        if scene.has.groups is not None:
            _store_group(scene, pool, rows, options, which, chosen)
    if scene.spectrum is not None:
        light = light_sample_at(scene, light, path_wavelengths(scene, pool, rows, options))
    if scene.has.links is not None:
        light = linked_sample(scene, which, u32(chosen), light, vertex.object)
    none = zero_like(light.pdf)
    seen_by = none
    if scene.has.visibility is not None:
        word = sampled_visibility(scene, which, u32(chosen))
        light, seen_by = with_visibility(light, word), to_float(word)
    number = gather(pool, rows, PathState).number
    branches = branches_to_light(light.alone, number, options)
    if scene.has.reflections is not None and options.has_mattes:
        caught = (number == _ZERO) & (gather(pool, rows, FirstHit).caught > _ZERO)
        reflects = catches_reflections(scene, caught, gather(pool, rows, Shading).material)
        branches = where(reflects, branches_at_catcher(scene, which, light.alone), branches)
    scatter(pool, rows, ChosenLight(light.direction, light.pdf, light.radiance, branches))
    scatter(pool, rows, Outcome((none, none, none), light.end, seen_by, none))


@subroutine
def choose_lights(scene, pool, lists, options):
    """Samples a light for each vertex that can use light sampling (list LIT); writes ChosenLight and Outcome to the pool."""
    never_inline()
    by_tree = False
    if scene.has.lights is not None:
        by_tree = len(scene.light_node) > 0
        if by_tree:
            _descend(scene, pool, lists, options)
    for k in range(0, pad(lists, LIT), 8):
        choose_light(scene, pool, eight_rows(lists, LIT, k), by_tree, options)
