"""Stage 3: samples a light for each vertex that can use light sampling.

With a light tree, all vertices descend it together, one step each in turn: a step is a few long sums and roots, which the
processor can overlap between vertices.
"""

from __future__ import annotations

import numpy as np

from renderer.arrays.light_rows import LIGHT_ROWS, LIGHT_WIDTH
from renderer.bvh.simd import store_int
from renderer.jit import device, out_of_line, subroutine
from renderer.kernel.light.light_tree import descend
from renderer.kernel.light.lights import nearby_choice, sample_by_power, sample_chosen
from renderer.kernel.pool.lists import LIT, NODES, eight, pad, put, row
from renderer.kernel.pool.rows import CARRIED, FRAME, LAMP, MAPPED, PLACE, SHADOW, WAY, at, few, times_of, write
from renderer.kernel.pool.scatter import stream_of
from renderer.kernel.pool.ways import three, word
from renderer.kernel.sampling.sampler import draw4
from renderer.wide.values import as_floats, as_ints, as_wide, nil, to_int, where

__all__ = ["choose_lamps"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_LIGHT_BLOCK = np.uint32(1)
_TWO = np.uint32(2)
_ROOT = np.uint32(0)
_NODE = np.uintp(LIGHT_ROWS * LIGHT_WIDTH)
_NUMBER = CARRIED + np.uintp(7)
# Of a vertex on its way down the tree, where no ray is under way: what is left of its choice, the chance of the way so far, the
# node or ~ light that it has come to. Behind them, the numbers that it has drawn, three.
_LEFT, _CHANCE, _HERE = WAY, WAY + np.uintp(1), WAY + np.uintp(2)


@device
def _numbers(pool, rows, options):
    """Returns the random numbers of eight rows: (two for the point on the light, one for the choice of the light)."""
    number = to_int(few(pool, rows, _NUMBER, 1)[0])
    u = draw4(stream_of(pool, rows, options), number * _TWO + _LIGHT_BLOCK)
    return u[0], u[1], u[2]


@device
def _facing(scene, pool, path):
    """Returns one row's normal for light sampling; zero where lights on all sides count."""
    if scene.has.textures is not None:
        return three(pool, path + MAPPED + np.uintp(3))
    return three(pool, path + FRAME)


@subroutine
def _go_down(scene, pool, lists, options):
    """Chooses a light for each listed vertex by the light tree; writes columns _CHANCE and _HERE."""
    out_of_line()
    waiting = np.uintp(pad(lists, LIT))
    for k in range(0, np.int64(waiting), 8):
        rows = eight(lists, LIT, k)
        u, v, choice = _numbers(pool, rows, options)
        _, left = nearby_choice(scene, choice)
        none = nil(left)
        root = as_floats(as_wide(_ROOT, none))
        write(pool, rows, WAY, (left, none + _ONE, root, u, v, choice, none, none))
    for k in range(np.int64(waiting)):
        put(lists, NODES, np.uintp(k), row(lists, LIT, k))
    while waiting > np.uintp(0):
        count, waiting = waiting, np.uintp(0)
        for k in range(np.int64(count)):
            number = row(lists, NODES, k)
            path = at(number, np.uintp(0))
            base = word(pool, path + _HERE) * _NODE
            p, n = three(pool, path + PLACE), _facing(scene, pool, path)
            child, share, left = descend(scene.light_node, base, p, n, pool[path + _LEFT])
            pool[path + _LEFT] = left
            pool[path + _CHANCE] *= share
            store_int(pool, path + _HERE, child)
            put(lists, NODES, waiting, number)
            waiting += np.uintp(child >= np.int32(0))


@subroutine
def choose_lamps(scene, pool, lists, options):
    """Samples a light for each vertex on the list LIT; writes the groups LAMP and SHADOW."""
    out_of_line()
    by_tree = False
    if scene.has.lights is not None:
        by_tree = len(scene.light_node) > 0
        if by_tree:
            _go_down(scene, pool, lists, options)
    for k in range(0, pad(lists, LIT), 8):
        rows = eight(lists, LIT, k)
        point, time = few(pool, rows, PLACE, 3), times_of(scene.has.motion, pool, rows)
        n = few(pool, rows, MAPPED + np.uintp(3), 3) if scene.has.textures is not None else few(pool, rows, FRAME, 3)
        if scene.has.lights is not None and by_tree:
            _, chance, here, u, v, choice = few(pool, rows, WAY, 6)
            chosen = as_ints(here) ^ np.uint32(0xFFFFFFFF)
            light = sample_chosen(scene, point, n, choice, (u, v), chosen, chance, time)
        else:
            u, v, choice = _numbers(pool, rows, options)
            light = sample_by_power(scene, point, n, choice, (u, v), time)
        none = nil(light.pdf)
        first = few(pool, rows, _NUMBER, 1)[0] == _ZERO
        finding = where(light.alone, none, where(first, none + np.float32(options.splitting), _ONE))
        write(pool, rows, LAMP, (*light.direction, light.pdf, *light.radiance, finding))
        write(pool, rows, SHADOW, (none, none, none, *light.end, none, none))
