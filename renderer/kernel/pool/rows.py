"""The layout of a path's row in the pool: groups of eight columns, each read and written for eight paths at once."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

from renderer.bvh.simd import f32x8
from renderer.jit import device
from renderer.prune_absent_features import where_present
from renderer.wide.rows import gather, gathered, scatter

__all__ = [
    "AXES",
    "BEHIND",
    "BRANCHES",
    "CARRIED",
    "COUNTS",
    "FIRST",
    "FRAME",
    "HIT",
    "LAMP",
    "LAYERS",
    "MAPPED",
    "MATTER",
    "NEST",
    "PATHS",
    "PLACE",
    "RAY",
    "ROW",
    "ROWS",
    "SAMPLE",
    "SHADOW",
    "SPARE",
    "START",
    "TIME",
    "WAY",
    "at",
    "few",
    "line_floats",
    "read",
    "time_of",
    "times_of",
    "write",
]

_LINE = 64  # bytes
PATHS = 128  # 64 to 256 are equally fast
ROWS = 2 * PATHS  # a path's second branch has the row PATHS behind that of the first
SPARE = np.uint32(ROWS)  # an extra row, for writes to be discarded
# Groups, by their first columns. Integers are stored as bits, except depth, number and surfaces passed.
RAY = np.uintp(0)  # origin 3, direction 3, pdf, worth: as in integrators/state.py's Path
CARRIED = np.uintp(8)  # radiance 3, depth, throughput 3, number of the vertex that the ray is on its way to
HIT = np.uintp(
    16
)  # t, u, v, primitive, instance; surfaces passed so far; for the protocol the object's number, and its light's share
SAMPLE = np.uintp(24)  # pixel key, sample's number, pixel's place in the tile; its x and y; time; how far from the lens it began;
# in the first branch's row, how many branches are under way
TIME = np.uintp(29)
START = np.uintp(30)
BRANCHES = np.uintp(31)
PLACE = np.uintp(32)  # the vertex: point 3, error, geometric normal 3, front + 2 smooth
FRAME = np.uintp(40)  # its shading normal 3, lift 3, material, the list that it is on (lists.py)
LAMP = np.uintp(48)  # towards the light 3, pdf, radiance 3, how many of the surface's directions might have found it; then what a
# shadow ray brings 3, by how many segments, its share, pdf, what it begins in
SHADOW = np.uintp(
    56
)  # the shadow ray's start 3 and end 3, whether it is to be cast, whether the path goes on (above 0: by which chance)
FIRST = np.uintp(64)  # first hit: albedo 3, distance, normal 3, 1 + object's number; place 3, 1 + material's number
# Only for scenes that are not plain:
MATTER = np.uintp(80)  # colour 3, metallic, roughness, eta, first texture coordinates 2
AXES = np.uintp(88)  # the frame to scatter in: s 3, t 3; second texture coordinates 2
MAPPED = np.uintp(96)  # its n 3, and the normal that lights count on the side of 3
# Traversal state of the ray (ways.py), four groups:
WAY = np.uintp(104)
# Only where there are media: what the path is in (kernel/medium/medium_stack.py). Of a vertex in one, MATTER's roughness is the
# g.
NEST = np.uintp(136)
# Only where bounces of some kind or layers are limited: the counts of integrators/depths.py, 4, the last of layers
COUNTS = np.uintp(137)
LAYERS = np.uintp(140)
# Only where there are media: distance of the surface that the ray passed through last; 0: none
BEHIND = np.uintp(141)
ROW = np.uintp(144)  # not a power of two, which would map all rows' groups to the same cache sets


def line_floats(count: int) -> npt.NDArray[np.float32]:
    """Returns that many zeros, float32, with the first aligned to a cache line."""
    memory = np.zeros(count + _LINE // 4, np.float32)
    first = -memory.ctypes.data % _LINE // 4
    return memory[first : first + count]


@device
def at(row, column):
    """Returns the flat index of a column of one row."""
    return np.uintp(row) * ROW + column


@device
def time_of(motion, pool, row):
    """Returns the shutter time of one row's sample; None for a scene without motion (motion: of
    renderer/arrays/scene_features.py)."""
    return where_present(motion, pool[at(row, TIME)])


@device
def read(pool, rows, group):
    """Reads a group's eight columns of eight rows (u32x8): eight f32x8."""
    return gather(pool, rows, ROW, group, 8)


@intrinsic(prefer_literal=True)
def few(typingctx, pool, rows, column, count):
    """Reads `count` columns, a literal, of eight rows (u32x8): f32x8 each."""

    def codegen(context, builder, sig, args):
        data = context.make_array(sig.args[0])(context, builder, args[0]).data
        width = ir.IntType(64)(int(ROW))
        wanted = count.literal_value
        found = gathered(builder, data, args[1], width, args[2], 4 if wanted == 3 else wanted)  # rows are longer than that
        return context.make_tuple(builder, sig.return_type, found[:wanted])

    return types.UniTuple(f32x8, count.literal_value)(pool, rows, types.uintp, count), codegen


@device
def write(pool, rows, group, columns):
    """Writes eight f32x8 to a group's eight columns of eight rows (u32x8)."""
    scatter(pool, rows, ROW, group, columns)


@device
def times_of(motion, pool, rows):
    """Returns `time_of` for eight rows (u32x8)."""
    return where_present(motion, few(pool, rows, TIME, 1)[0])
