"""The layout of a path's row in the pool: its columns are the fields of named tuples (of kernel/steps and of this module).

`gather` and `scatter`, generated from the layout, read and write one of these tuples for one row or for eight rows at once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.jit import device
from renderer.kernel.light_groups import GROUP_ROW
from renderer.kernel.sampling.sampler import pixel_key
from renderer.kernel.spectrum.wavelengths import wavelengths_of
from renderer.kernel.steps.record_first_hit import FirstHit
from renderer.kernel.steps.state import Crossings, LastVertex, PathState, Ray, scattering_surface, stream_of
from renderer.kernel.surface.surface import NO_OBJECT
from renderer.prune_absent_features import function_if, where_present
from renderer.wide.fields import Flag, Float, Int, Layout, Pair, Vector, accessors
from renderer.wide.values import as_wide, u32, where

__all__ = [
    "CAUSTIC_ROW",
    "FIRST_GROUP",
    "LAYOUT",
    "PATHS",
    "ROW",
    "ROWS",
    "SECOND",
    "SPARE",
    "Appearance",
    "Axes",
    "CausticPath",
    "ChosenLight",
    "DirectLight",
    "EarlierVertex",
    "Facet",
    "LightDescent",
    "Mapped",
    "MediumFlight",
    "Outcome",
    "RowHit",
    "Sample",
    "Shading",
    "Traversal",
    "at",
    "camera_stream",
    "caustic_floats",
    "caustic_row",
    "column",
    "first_rows",
    "gather",
    "gather_caustic",
    "group_floats",
    "group_row",
    "last_vertex",
    "line_floats",
    "path_wavelengths",
    "scatter",
    "scatter_caustic",
    "second_rows",
    "spare_where_not",
    "streams_of",
    "surface_of",
    "time_of",
]

_LINE = 64  # bytes
PATHS = 128  # 64 to 256 are equally fast
ROWS = 2 * PATHS  # the row of a path's second branch is PATHS rows after that of the first
SECOND = np.uint32(PATHS)
SPARE = np.uint32(ROWS)  # an extra row, for writes to be discarded


class RowHit(NamedTuple):
    """The closest hit found so far for the ray in one row (path) of the pool."""

    t: Float
    u: Float
    v: Float
    primitive: Int
    instance: Int
    passed: Float  # count of surfaces that the path has passed so far
    object: Int  # for the path trace: the object's number,
    weight: Float  # the MIS weight of its emission


class Sample(NamedTuple):
    """The sample of the film that the path in a row of the pool computes."""

    pixel: Int  # the pixel's key (sampler.py)
    number: Int
    place: Int  # of the pixel in the tile
    x: Int
    y: Int
    time: Float  # shutter time
    start: Float  # distance of the camera ray's origin from the lens
    branches: Float  # in the first branch's row: number of branches that have not terminated


class Facet(NamedTuple):
    """The geometric data of a path's vertex, without interpolation: position with its error, geometric normal, and side hit."""

    point: Vector
    error: Float
    geometric: Vector
    front: Flag
    smooth: Flag


class Shading(NamedTuple):
    """The shading normal of a path's vertex, the index of its material, and the list on which the vertex will be scattered."""

    normal: Vector
    lift: Vector
    material: Int
    list: Int  # the list on which the vertex is (lists.py)


class ChosenLight(NamedTuple):
    """The light sampled for a path's vertex: direction, pdf and radiance."""

    direction: Vector
    pdf: Float
    radiance: Vector
    branches: Float  # from `branches_to_light`


class DirectLight(NamedTuple):
    """The direct light that a path's vertex receives if its shadow ray is not occluded."""

    brought: Vector
    segments: Float
    weight: Float  # for the path trace: the MIS weight of the light sample,
    pdf: Float  # and its density
    medium_stack: Int
    root: Int  # index into `ray_roots` for the shadow ray; only in scenes with visibility by kind of ray


class Outcome(NamedTuple):
    """The shadow ray of a path's vertex, and the survival probability of the path."""

    start: Vector
    end: Vector
    is_cast: Float  # not 0: the shadow ray is traced; before scattering: the sampled light's word (light/visibility.py)
    survival: Float  # from `continue_or_end`


class Appearance(NamedTuple):
    """The parameters of the material at a path's vertex, with textures applied; only in scenes with textures.

    At a vertex in a medium, `roughness` is the phase function's mean cosine.
    """

    base: Vector
    metallic: Float
    roughness: Float
    eta: Float
    uv: Pair


class Axes(NamedTuple):
    """The tangents of the shading frame at a path's vertex; only in scenes with textures."""

    s: Vector
    t: Vector
    uv1: Pair


class Mapped(NamedTuple):
    """Two normals of a path's vertex, only in scenes with textures: the normal-mapped one, and the one to store in LastVertex."""

    normal: Vector
    facing: Vector
    object: Int  # the number to store in LastVertex; only in scenes with light links


class Traversal(NamedTuple):
    """The state of a BVH traversal by the ray of one row of the pool (traversal_state.py)."""

    inverse: Vector  # 1 / direction
    near: Vector  # constants of the near planes: a plane at x is hit at x * inverse + constant
    top: Int  # offset of the ray's topmost stack entry
    child: Int  # the node or leaf to visit next, as in renderer/bvh/layout.py
    far: Vector  # constants of the far planes
    plane_x: Int  # first element of the row of a node with the near planes; far planes are WIDTH elements away
    plane_y: Int
    plane_z: Int
    axis_x: Int  # rows of a corner that are x, y, z in the watertight test (renderer/bvh/packet.py)
    axis_y: Int
    axis_z: Int
    shear: Vector
    origin: Vector  # in the order of these axes
    best: Float  # distance of the nearest hit so far; for shadow rays: not 0 if occluded
    margin: Float  # of renderer/bvh/slabs.py


class LightDescent(NamedTuple):
    """The state of a path's vertex while it descends the light tree to choose a light."""

    left: Float  # the random number for the next choice, rescaled to [0, 1)
    chance: Float  # probability of the nodes chosen so far
    here: Int  # the node, or ~ light
    u: Float
    v: Float
    choice: Float


class MediumFlight(NamedTuple):
    """The outcome of a path's free flight in its medium: 1 if the path scatters before it reaches the hit, else 0."""

    scatters: Float


class EarlierVertex(NamedTuple):
    """The point and normal, as in LastVertex, of the vertex before a path's current one; only with CausticTables."""

    point: Vector
    normal: Vector


LAYOUT = Layout(
    Ray,
    PathState,
    RowHit,
    Sample,
    Facet,
    Shading,
    (ChosenLight, DirectLight),
    Outcome,
    FirstHit,
    Appearance,
    Axes,
    Mapped,
    (Traversal, LightDescent, MediumFlight, EarlierVertex),  # the stages that use these never overlap
    Crossings,
)
assert LAYOUT.width & (LAYOUT.width - 1), "a power of two would map all rows' groups to the same cache sets"
ROW = np.uintp(LAYOUT.width)
column = LAYOUT.column
gather, scatter = accessors(LAYOUT)


FIRST_GROUP = np.uint32((ROWS + 1) * LAYOUT.width // GROUP_ROW)  # the first row of the light by group, behind the paths' rows
assert LAYOUT.width % GROUP_ROW == 0
_GROUP_ROWS = np.uint32(LAYOUT.width // GROUP_ROW)  # rows of the light by group in the place of one of a path


def group_floats(rows: int) -> int:
    """Returns how many float32 lie behind the paths' rows, for `rows` rows of a branch (`group_rows` of options.py)."""
    return (ROWS + 1) * rows * GROUP_ROW


@device
def group_row(pool, rows, options):
    """Returns the row of the first group of the path in one row of the pool or in eight, for renderer/kernel/light_groups.py."""
    first = FIRST_GROUP
    if pool.ndim == 2:  # a graphics card's
        first = np.uint32(pool.shape[1]) * _GROUP_ROWS
    return rows * options.group_rows + first


class CausticPath(NamedTuple):
    """State of manifold sampling for a path, behind the light by group of all rows; only with CausticTables."""

    chain: Int  # state of its chain (kernel/manifold/chain.py)
    light: Vector  # sampled at its vertex, to be added after the light of the shadow ray


_CAUSTIC_LAYOUT = Layout(CausticPath)
CAUSTIC_ROW = _CAUSTIC_LAYOUT.width
assert CAUSTIC_ROW == GROUP_ROW
gather_caustic, scatter_caustic = accessors(_CAUSTIC_LAYOUT, row_major=True)
_ALL_ROWS = np.uint32(ROWS + 1)


def caustic_floats() -> int:
    """Returns how many float32 lie behind the paths' rows and their light by group, for the rows of CausticPath."""
    return (ROWS + 1) * CAUSTIC_ROW


@device
def caustic_row(pool, rows, options):
    """Returns the row of the CausticPath of the path in one row of the pool or of those in eight, for `gather_caustic`."""
    first = FIRST_GROUP + _ALL_ROWS * options.group_rows
    if pool.ndim == 2:  # a graphics card's
        first = np.uint32(pool.shape[1]) * (_GROUP_ROWS + options.group_rows)
    return rows + u32(first)


def line_floats(count: int) -> npt.NDArray[np.float32]:
    """Returns an array of `count` zeros, float32, aligned to a cache line."""
    memory = np.zeros(count + _LINE // 4, np.float32)
    first = -memory.ctypes.data % _LINE // 4
    return memory[first : first + count]


@device
def at(row, field):
    """Returns the flat index into the pool of column `field` in row number `row`."""
    return np.uintp(row) * ROW + field


@device
def second_rows(pool, rows):
    """Returns the rows of the second branches of the paths in one row of the pool or in eight."""
    second = SECOND
    if pool.ndim == 2:  # a graphics card's
        second = np.uint32(pool.shape[1] // 2)
    return u32(rows + second)


@device
def first_rows(pool, rows):
    """Returns the rows of the first branches of the paths in one row of the pool or in eight, which are of either branch."""
    second = SECOND
    if pool.ndim == 2:  # a graphics card's
        second = np.uint32(pool.shape[1] // 2)
    return where(rows < second, rows, u32(rows - second))


@device
def spare_where_not(pool, chosen, rows):
    """Returns one row of the pool or eight, with the spare row in place of those that are not chosen. chosen: a mask."""
    spare = SPARE
    if pool.ndim == 2:  # a graphics card's
        spare = np.uint32(pool.shape[1] - 1)
    return where(chosen, rows, spare)


@device
def time_of(motion, pool, rows):
    """Returns the shutter time of the sample in one row of the pool, or of the samples in eight.

    Returns None if `motion` (renderer/arrays/scene_features.py) is None.
    """
    return where_present(motion, gather(pool, rows, Sample).time)


@device
def streams_of(pool, rows, options):
    """Returns the random number streams of the samples in one row of the pool or in eight."""
    sample = gather(pool, rows, Sample)
    return stream_of(options, sample.pixel, sample.number)


@device
def path_wavelengths(scene, pool, rows, options):
    """Returns the wavelengths of the path in one row of the pool or of those in eight; None in kernels without spectra."""
    return function_if(scene.spectrum, _own_wavelengths, _no_wavelengths)(scene, pool, rows, options)


@device
def _own_wavelengths(scene, pool, rows, options):
    return wavelengths_of(scene, camera_stream(gather(pool, rows, Sample), options))


@device
def _no_wavelengths(scene, pool, rows, options):
    return None


@device
def camera_stream(sample, options):
    """Returns the random number stream of a Sample's camera ray, which the second branch of its path does not have."""
    return stream_of(options, pixel_key(sample.x, sample.y), sample.number)


@device
def last_vertex(scene, pool, rows):
    """Returns the LastVertex of the paths in one row of the pool or in eight: the vertices that their rays have left."""
    normal, point = gather(pool, rows, Shading).normal, gather(pool, rows, Facet).point
    number = as_wide(NO_OBJECT, point[0])
    if scene.has.textures is not None:
        normal, number = gather(pool, rows, Mapped).facing, gather(pool, rows, Mapped).object
    return LastVertex(point, normal, number)


@device
def surface_of(pool, rows, facet, shading):
    """Returns the surfaces at the vertices of the paths in these rows of the pool, with only the fields that scattering needs.

    facet, shading: the rows' Facet and Shading.
    """
    uv, uv1, number = gather(pool, rows, Appearance).uv, gather(pool, rows, Axes).uv1, gather(pool, rows, RowHit).object
    return scattering_surface(
        facet.point,
        facet.error,
        facet.geometric,
        shading.normal,
        facet.front,
        shading.material,
        facet.smooth,
        shading.lift,
        uv,
        uv1,
        number,
    )
