"""Exact annotation of a picture at its pixel centres: positions, normals, ids, layers, flow and boxes, for data sets.

It is a separate pass with one ray per pixel, like motion vectors (renderer/vectors.py), and not a plane of the film: a film
stores means over samples, and the mean of two depths or ids is neither. Its cost does not depend on the samples per pixel.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer import jit
from renderer.arrays.kernel_variant import moving_variant, strip_absent_features
from renderer.arrays.rows import PART_OBJECT
from renderer.arrays.scene import example
from renderer.bvh.layout import INSTANCE, LEAF_KIND, ROW_CHILD, ROW_PRIMITIVE
from renderer.bvh.traverse import new_stack
from renderer.exposure import PixelTimes, pixel_times
from renderer.kernel.annotation import (
    AREA,
    BOTTOM,
    EXTENT_COLUMNS,
    HIT_COLUMNS,
    ID_COLUMNS,
    INSTANCE_ID,
    LAST,
    LEFT,
    MATERIAL_ID,
    OBJECT_ID,
    RIGHT,
    RUNS,
    TOP,
    VISIBLE,
    WHOLE,
    list_runs,
    locate_points,
    measure_masks,
    trace_annotation,
    trace_occlusion,
)
from renderer.kernel.camera import camera_frame
from renderer.reference import Packed
from renderer.scene.animation import BETWEEN, Shutter
from renderer.scene.compiled import CompiledScene
from renderer.scene.origin import settings_relative_to_origin
from renderer.settings import RenderSettings, View
from renderer.threads import Team, parts_of
from renderer.vectors import load_projection, projected

__all__ = [
    "AFTER",
    "BEFORE",
    "NOW",
    "Annotation",
    "Body",
    "Flow",
    "Mask",
    "annotate",
    "bodies_of",
    "body_numbers",
    "flow_to",
    "load_kernel",
    "masks_of",
]

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]

BEFORE, NOW, AFTER = range(3)  # times of `Annotation.places_at`: the previous, this and the next frame
_TIMES = (np.float32(0.0), np.float32(0.5), np.float32(1.0))
_KERNEL = "annotation"
_ROWS = 16  # rows of pixels per part
_ROUNDS = 40  # of an iteration
_EXACT, _CONVERGED = 1e-5, 1e-3  # pixels by which a time is off: where an iteration ends, and what it must have reached
_LAYERS = 8  # at first; a picture with deeper pixels is traced again


class Annotation(NamedTuple):
    """The first hits of the rays through the pixel centres of a picture of h rows and w columns.

    NOW is the middle of a pixel's own exposure; BEFORE and AFTER are a frame earlier and later.
    """

    places: F64  # (h, w, 3, 4), or (h, w, 1, 4) if nothing moves: see `places_at`
    hits: F64  # (h, w, HIT_COLUMNS), of `trace_annotation`; without columns unless the shutter rolls
    normal: F32  # (h, w, 3): unit, world space, on the viewer's side; 0 without a surface
    ids: I32  # (h, w, ID_COLUMNS): numbers of object, instance and material
    layers: I32  # (h, w, d, 2): object and instance of all surfaces along the ray, each once, -1 for none; d = 0: not traced

    def places_at(self, when: int) -> F64:
        """Returns points (h, w, 4) at BEFORE, NOW or AFTER, relative to the scene's origin, and 1; directions and 0."""
        return self.places[:, :, when if self.places.shape[2] > 1 else 0]

    @property
    def object(self) -> I32:
        """Returns the number of each pixel's object (h, w), -1 for none."""
        return self.ids[..., OBJECT_ID]

    @property
    def instance(self) -> I32:
        """Returns each pixel's compiled instance (h, w); -1 for the world's own geometry, or none."""
        return self.ids[..., INSTANCE_ID]

    @property
    def material(self) -> I32:
        """Returns the number of each pixel's material (h, w), -1 for none."""
        return self.ids[..., MATERIAL_ID]


class Body(NamedTuple):
    """A separately placed thing of a scene: an object of the world, or one of its instances. An object may have several."""

    object: int  # number, as in the OBJECT plane less 1
    instance: int  # number of the compiled instance; -1 for geometry that is in world space
    corners: F64  # (8, 3): of its bounding box, world space; aligned with the instance's axes, or the world's
    pose: F64  # (4, 4): from its own space to world space; the identity for geometry that is in world space


class Mask(NamedTuple):
    """The pixels in which a body is seen, or would be if nothing occluded it."""

    area: int  # number of pixels
    box: tuple[int, int, int, int] | None  # x, y, width, height in pixels; None if there are none
    edges: list[int]  # start and end of each run of pixels, numbered column by column; empty if not requested


class Flow(NamedTuple):
    """Motion in the picture from one view to another."""

    offset: F32  # (h, w, 2): pixels to the right and downwards; NaN behind the other camera
    occluded: npt.NDArray[np.bool_]  # (h, w): whether the point is hidden in the other view, or outside its picture


def annotate(
    scene: CompiledScene,
    settings: RenderSettings,
    layers: bool = True,
    threads: int | None = None,
    window: Shutter | None = BETWEEN,
) -> Annotation:
    """Returns the annotation of a picture. scene: static, or compiled over the time `window` of `window_between`, for flow.

    settings: their size, view and rolling shutter are used; the lens is a pinhole. layers: whether to trace all surfaces along
    each ray. window: None if the scene is compiled over the settings' own shutter; BEFORE and AFTER are then as NOW.
    """
    settings = _sharp(settings, scene)
    shape = settings.height, settings.width
    prepared, camera = strip_absent_features(scene, moving_variant(scene)), camera_frame(settings)
    packed = Packed(prepared)
    when = pixel_times(settings, window)
    times = _frame_times(when, shape)
    moves = len(prepared.key_position) > 0 or len(prepared.key_sphere) > 0 or len(prepared.bvh.instance_motion) > 0
    places, hits = np.empty((*shape, 3 if moves else 1, 4)), np.empty((*shape, HIT_COLUMNS if when.is_rolling else 0))
    normals = np.empty((*shape, 3), np.float32)
    ids, counts = np.empty((*shape, ID_COLUMNS), np.int32), np.zeros(shape, np.int32)
    room = _LAYERS if layers else 0
    if not jit.is_ready(_KERNEL):
        load_kernel()
    with Team(threads) as team:
        while True:
            listed = np.empty((*shape, room, 2), np.int32)

            def trace_part(part: tuple[int, int], listed: I32 = listed) -> None:
                rows = slice(*part)
                arrays = times[rows], places[rows], hits[rows], normals[rows], ids[rows], listed[rows], counts[rows]
                trace_annotation(packed, new_stack(), camera, part[0], *arrays)

            team.each(trace_part, parts_of(0, settings.height, _ROWS))
            if not layers or counts.max(initial=0) <= room:
                break
            room = int(counts.max())
    return Annotation(places, hits, normals, ids, listed)


def body_numbers(bodies: Sequence[Body], objects: int) -> tuple[I32, I32]:
    """Returns 1 + the index of the body of each object's geometry in world space, and of each instance; 0 for none."""
    of_world = np.zeros(objects + 1, np.int32)
    of_instance = np.zeros(1 + max((body.instance + 1 for body in bodies), default=0), np.int32)
    for n, body in enumerate(bodies, 1):
        if body.instance < 0:
            of_world[body.object] = n
        else:
            of_instance[body.instance] = n
    return of_world, of_instance


def masks_of(found: Annotation, numbers: tuple[I32, I32], count: int, runs: bool = True) -> list[tuple[Mask, Mask]]:
    """Returns the masks of `count` bodies in an annotated picture: whole and visible. numbers: from `body_numbers`."""
    extents = np.zeros((count, 2, EXTENT_COLUMNS), np.int64)
    extents[..., LAST] = -2
    measure_masks(found.layers, found.ids, *numbers, extents)
    ends = np.cumsum(2 * extents[..., RUNS]).reshape(count, 2)
    starts = ends - 2 * extents[..., RUNS]
    edges = np.empty(int(ends.max(initial=0)) if runs else 0, np.int64)
    if runs:
        list_runs(found.layers, found.ids, *numbers, np.stack([starts, np.full_like(starts, -1)], axis=2), edges)

    def mask(body: int, which: int) -> Mask:
        extent = extents[body, which].tolist()
        x, y = extent[LEFT], extent[TOP]
        box = (x, y, extent[RIGHT] + 1 - x, extent[BOTTOM] + 1 - y) if extent[AREA] else None
        return Mask(extent[AREA], box, edges[starts[body, which] : ends[body, which]].tolist())

    return [(mask(body, WHOLE), mask(body, VISIBLE)) for body in range(count)]


def flow_to(
    scene: CompiledScene,
    settings: RenderSettings,
    found: Annotation,
    other: View,
    when: int,
    threads: int | None = None,
    window: Shutter | None = BETWEEN,
) -> Flow:
    """Returns the motion from the annotated picture to that of another view, at the frame `when`: BEFORE or AFTER.

    With a rolling shutter the flow ends where the other picture's rows see the point at their own time; it is NaN where no row
    does, or where the point moves about as fast as the readout. scene, window: as for `annotate`; for a static scene, the flow is
    that of the camera alone. settings: those of the annotated picture.
    """
    here = _sharp(settings, scene)
    there = _sharp(replace(settings, view=other), scene)
    prepared = Packed(strip_absent_features(scene, moving_variant(scene)))
    times = pixel_times(settings, window)
    shape = settings.height, settings.width
    now, then = found.places_at(NOW), found.places_at(when)
    offset, occluded = np.empty((*shape, 2), np.float32), np.empty(shape, np.uint8)
    eye = tuple(np.float64(v) for v in there.view.eye)
    with Team(threads) as team:
        rolled = _where_rows_see(prepared, here, there, found, times, when, team) if times.is_rolling else None

        def trace_part(part: tuple[int, int]) -> None:
            rows = slice(*part)
            start = projected(here.view, here, now[rows])
            if rolled is None:
                moved = np.ascontiguousarray(then[rows])
                end = projected(there.view, there, moved)
                seen = np.full(moved.shape[:2], _TIMES[when])
            else:
                moved, end, seen = rolled[0][rows], rolled[1][rows], rolled[2][rows]
            x, y = end[..., 0], end[..., 1]
            with np.errstate(invalid="ignore"):
                inside = (x >= 0.0) & (x <= settings.width) & (y >= 0.0) & (y <= settings.height)  # False for NaN
            occluded[rows] = ~inside
            offset[rows] = end - start
            trace_occlusion(prepared, new_stack(), eye, moved, seen, occluded[rows])

        team.each(trace_part, parts_of(0, settings.height, _ROWS))
    return Flow(offset, occluded != 0)


def _where_rows_see(
    scene: Packed, here: RenderSettings, there: RenderSettings, found: Annotation, times: PixelTimes, when: int, team: Team
) -> tuple[F64, F64, F32]:
    """Returns points (h, w, 4), positions (h, w, 2) and times (h, w) at which a rolling shutter sees points in another frame.

    The time at which a point is seen depends on its row, and its row on the time: a fixed point, by iteration, which converges if
    the point moves slower in the picture than the readout. Positions are NaN where it does not.
    """
    camera = camera_frame(here)
    own = times.at(*_pixel_centres((here.height, here.width)))
    shift = (when - NOW) * times.frame
    target, places = own + shift, np.empty((*own.shape, 1, 4))
    pixel = abs(times.across) + abs(times.down)
    for _ in range(_ROUNDS):
        pairs = np.stack([own, target], axis=2).astype(np.float32)

        def locate_part(part: tuple[int, int], pairs: F32 = pairs) -> None:
            rows = slice(*part)
            locate_points(scene, camera, part[0], pairs[rows], found.hits[rows], places[rows])

        team.each(locate_part, parts_of(0, here.height, _ROWS))
        end = projected(there.view, there, places[:, :, 0])
        x, y = (np.clip(np.nan_to_num(end[..., k]), 0.0, most) for k, most in ((0, here.width), (1, here.height)))
        before, target = target, times.at(x, y) + shift
        off = abs(target - before) / pixel
        if off.max(initial=0.0) < _EXACT:
            break
    end[off > _CONVERGED] = np.nan
    return np.ascontiguousarray(places[:, :, 0]), end, target.astype(np.float32)


def _pixel_centres(shape: tuple[int, int]) -> tuple[F64, F64]:
    """Returns x and y of the centres of a picture's pixels (h, w)."""
    y, x = np.mgrid[0 : shape[0], 0 : shape[1]] + 0.5
    return x, y


@functools.lru_cache(2)
def _frame_times(when: PixelTimes, shape: tuple[int, int]) -> F32:
    """Returns times (h, w, 3) a frame before, at, and a frame after the pixels' exposures. They must not be changed."""
    now = when.at(*_pixel_centres(shape))
    return np.stack([now - when.frame, now, now + when.frame], axis=2).astype(np.float32)


def load_kernel() -> None:
    """Compiles or loads the kernels for annotation."""
    nothing = RenderSettings(1, 1, View((0.2, 0.2, 1.0), (0.2, 0.2, 0.0)))
    scene, camera = Packed(strip_absent_features(example(), moving_variant(example()))), camera_frame(nothing)
    ids, counts = np.empty((0, 1, ID_COLUMNS), np.int32), np.empty((0, 1), np.int32)
    with jit.compiling(_KERNEL):
        arrays = np.empty((0, 1, 3), np.float32), np.empty((0, 1, 3, 4)), np.empty((0, 1, HIT_COLUMNS))
        planes = np.empty((0, 1, 3), np.float32), ids, np.empty((0, 1, 1, 2), np.int32), counts
        trace_annotation(scene, new_stack(), camera, 0, *arrays, *planes)
        eye = np.float64(0.0), np.float64(0.0), np.float64(0.0)
        times = np.empty((0, 1), np.float32)
        trace_occlusion(scene, new_stack(), eye, np.empty((0, 1, 4)), times, np.empty((0, 1), np.uint8))
        load_projection()
        bodies = np.empty((0, 1, 1, 2), np.int32), ids, np.empty(0, np.int32), np.empty(0, np.int32)
        measure_masks(*bodies, np.empty((0, 2, EXTENT_COLUMNS), np.int64))
        list_runs(*bodies, np.empty((0, 2, 2), np.int64), np.empty(0, np.int64))


def bodies_of(scene: CompiledScene) -> list[Body]:
    """Returns the bodies of a scene at one moment: the objects in world space by number, then the instances."""
    count = max((int(each.max()) + 1 for each in (scene.part[:, PART_OBJECT], scene.sphere_object) if each.size), default=0)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    number = scene.part[scene.triangle[:, 3], PART_OBJECT]
    inside = number >= 0
    for k in range(3):
        corner = scene.position[scene.triangle[inside, k]].astype(np.float64)
        np.minimum.at(low, number[inside], corner)
        np.maximum.at(high, number[inside], corner)
    center, radius = scene.sphere[:, :3].astype(np.float64), scene.sphere[:, 3:].astype(np.float64)
    np.minimum.at(low, scene.sphere_object, center - radius)
    np.maximum.at(high, scene.sphere_object, center + radius)
    there = np.flatnonzero(np.isfinite(low).all(axis=1))
    found = [Body(int(n), -1, _box_corners(low[n], high[n]) + scene.origin, np.eye(4)) for n in there]
    boxes: dict[int, F64] = {}
    for n, root in enumerate(scene.bvh.instance_root.tolist()):
        if root not in boxes:
            points = scene.position[scene.triangle[_triangles_below(scene, root), :3]].reshape(-1, 3).astype(np.float64)
            boxes[root] = _box_corners(points.min(axis=0), points.max(axis=0))
        placed = boxes[root] @ scene.to_world[n, :, :3].T + scene.to_world[n, :, 3]
        pose = np.eye(4)
        pose[:3] = scene.to_world[n]
        pose[:3, 3] += scene.origin
        found.append(Body(int(scene.instance_object[n]), n, placed + scene.origin, pose))
    return found


def _triangles_below(scene: CompiledScene, root: int) -> I32:
    """Returns the numbers of the triangles in a tree, given by its root node."""
    nodes, leaves = np.array([root]), [np.zeros(0, np.int32)]
    while len(nodes):
        lanes = scene.bvh.node[nodes]
        filled = lanes[:, 0] <= lanes[:, 1]
        child = lanes[:, ROW_CHILD].view(np.int32)[filled]
        leaf = ~child[child < 0]
        packets = scene.bvh.packet[leaf[leaf & LEAF_KIND != INSTANCE] >> 2]
        leaves.append(packets[:, ROW_PRIMITIVE].view(np.int32)[~np.isnan(packets[:, 0])])
        nodes = child[child >= 0]
    return np.concatenate(leaves)


def _box_corners(low: F64, high: F64) -> F64:
    """Returns the eight corners (8, 3) of a box; the bits of a corner's number select the upper end of x, y and z."""
    return np.array([[high[k] if n >> k & 1 else low[k] for k in range(3)] for n in range(8)])


def _sharp(settings: RenderSettings, scene: CompiledScene) -> RenderSettings:
    """Returns the settings with a pinhole that does not move, relative to the scene's origin."""
    return settings_relative_to_origin(replace(settings, view=replace(settings.view, aperture=0.0), views=()), scene.origin)
