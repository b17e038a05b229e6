"""Exact annotation of pixels: what the rays through pixel centres meet, without filtering.

A ray goes through the centre of its pixel and of the lens, at the middle of the pixel's exposure. Surfaces with an opacity below
1/2 and lamps that let rays pass are not met, as for motion vectors (vectors.py).
"""

from __future__ import annotations

import math

import numpy as np

from renderer.bvh.hit import Hit
from renderer.bvh.traverse import FROM_ORIGIN, NO_PRIMITIVE
from renderer.jit import device, entry, never_inline, subroutine
from renderer.kernel.camera import moving_ray
from renderer.kernel.surface.surface import owner_at, surface_at
from renderer.kernel.vectors import next_visible, write_place
from renderer.reference import by_reference

__all__ = [
    "AREA",
    "BOTTOM",
    "EXTENT_COLUMNS",
    "HIT_COLUMNS",
    "ID_COLUMNS",
    "INSTANCE_ID",
    "LAST",
    "LEFT",
    "MATERIAL_ID",
    "OBJECT_ID",
    "RIGHT",
    "RUNS",
    "TOP",
    "VISIBLE",
    "WHOLE",
    "list_runs",
    "locate_points",
    "measure_masks",
    "trace_annotation",
    "trace_occlusion",
]

OBJECT_ID, INSTANCE_ID, MATERIAL_ID = range(3)  # columns of `ids`
ID_COLUMNS = 3
HIT_T, HIT_U, HIT_V, HIT_INSTANCE, HIT_PRIMITIVE = range(5)  # columns of `hits`
HIT_COLUMNS = 5
WHOLE, VISIBLE = range(2)  # masks of a body: all of it, whether occluded or not, and what is seen
AREA, LEFT, RIGHT, TOP, BOTTOM, RUNS, LAST = range(7)  # columns of `extents`
EXTENT_COLUMNS = 7

_HALF, _INF = np.float32(0.5), np.float32(np.inf)
_MIDDLE = (_HALF, _HALF)
_NEARER = 1.0 - 1e-4  # of the distance to a point: a surface before it occludes it
_TRACED = 1.0 - 0.99e-4  # of the distance to a point: where occlusion rays end


@device
def _is_listed(layers, y, x, count, number, instance):
    """Returns True if the object and instance are among the first `count` layers of a pixel."""
    found = False
    for k in range(count):
        found = found or (layers[y, x, k, 0] == number and layers[y, x, k, 1] == instance)
    return found


@subroutine
def _list_layers(scene, stack, o, d, hit, y, x, layers, counts):
    """Lists each object and instance once that the ray meets, from the Hit `hit` on; `counts` also has those without room."""
    never_inline()
    count = 0
    for k in range(layers.shape[2]):
        layers[y, x, k, 0] = layers[y, x, k, 1] = np.int32(-1)
    while hit.primitive != NO_PRIMITIVE:
        number = np.int32(owner_at(scene, hit)[0])
        room = min(count, layers.shape[2])
        if not _is_listed(layers, y, x, room, number, hit.instance):
            if count < layers.shape[2]:
                layers[y, x, count, 0] = number
                layers[y, x, count, 1] = hit.instance
            count += 1
        hit = next_visible(scene, stack, o, d, _INF, hit.time, (hit.t, hit.instance, hit.primitive))
    counts[y, x] = count


@subroutine
def _annotate(scene, stack, camera, top, times, places, hits, normals, ids, layers, counts):
    never_inline()
    for y in range(places.shape[0]):
        for x in range(places.shape[1]):
            time = times[y, x, 1]
            o, d, _ = moving_ray(camera, np.float32(x) + _HALF, np.float32(top + y) + _HALF, _MIDDLE, time)
            hit = next_visible(scene, stack, o, d, _INF, time, FROM_ORIGIN)
            for which in range(places.shape[2]):
                write_place(scene, hit, o, d, y, x, which, times[y, x, which if places.shape[2] == 3 else 1], places)
            if hits.shape[2] > 0:
                hits[y, x, HIT_T], hits[y, x, HIT_U], hits[y, x, HIT_V] = hit.t, hit.u, hit.v
                hits[y, x, HIT_INSTANCE], hits[y, x, HIT_PRIMITIVE] = hit.instance, hit.primitive
            for k in range(3):
                normals[y, x, k] = np.float32(0.0)
                ids[y, x, k] = np.int32(-1)
            if hit.primitive != NO_PRIMITIVE:
                surface = surface_at(scene, o, d, hit)
                normals[y, x, 0] = surface.shading[0]
                normals[y, x, 1] = surface.shading[1]
                normals[y, x, 2] = surface.shading[2]
                ids[y, x, OBJECT_ID] = np.int32(surface.object)
                ids[y, x, INSTANCE_ID] = hit.instance
                ids[y, x, MATERIAL_ID] = np.int32(surface.material)
            if layers.shape[2] > 0:
                _list_layers(scene, stack, o, d, hit, y, x, layers, counts)


@subroutine
def _locate(scene, camera, top, times, hits, places):
    never_inline()
    for y in range(places.shape[0]):
        for x in range(places.shape[1]):
            time = times[y, x, 0]
            o, d, _ = moving_ray(camera, np.float32(x) + _HALF, np.float32(top + y) + _HALF, _MIDDLE, time)
            t, u, v = np.float32(hits[y, x, HIT_T]), np.float32(hits[y, x, HIT_U]), np.float32(hits[y, x, HIT_V])
            hit = Hit(t, np.int32(hits[y, x, HIT_PRIMITIVE]), u, v, np.int32(hits[y, x, HIT_INSTANCE]), time)
            write_place(scene, hit, o, d, y, x, 0, times[y, x, 1], places)


@subroutine
def _occlude(scene, stack, eye, places, times, occluded):
    never_inline()
    for y in range(places.shape[0]):
        for x in range(places.shape[1]):
            if occluded[y, x] != 0:
                continue
            near = places[y, x, 3]
            a, b, c = places[y, x, 0] - near * eye[0], places[y, x, 1] - near * eye[1], places[y, x, 2] - near * eye[2]
            length = math.sqrt(a * a + b * b + c * c)
            if length == 0.0:
                continue
            o = np.float32(eye[0]), np.float32(eye[1]), np.float32(eye[2])
            d = np.float32(a / length), np.float32(b / length), np.float32(c / length)
            t_max = _INF if near == 0.0 else np.float32(_TRACED * length)
            hit = next_visible(scene, stack, o, d, t_max, times[y, x], FROM_ORIGIN)
            if hit.primitive != NO_PRIMITIVE and (near == 0.0 or np.float64(hit.t) < _NEARER * length):
                occluded[y, x] = np.uint8(1)


@device
def _body_of(number, instance, of_world, of_instance):
    """Returns 1 + the index of the body of an object and an instance; 0 for none."""
    body = np.int32(0)
    if number >= 0:
        if instance < 0:
            body = of_world[number] if number < len(of_world) else body
        else:
            body = of_instance[instance] if instance < len(of_instance) else body
    return body


@device
def _measure_pixel(extent, x, y, pixel):
    """Adds a pixel to the extent of a mask, (EXTENT_COLUMNS,), unless it is the last one already."""
    if extent[LAST] == pixel:
        return
    if extent[AREA] == 0:
        extent[LEFT], extent[TOP], extent[BOTTOM] = x, y, y
    if extent[AREA] == 0 or extent[LAST] != pixel - 1:
        extent[RUNS] += 1
    extent[AREA] += 1
    extent[RIGHT] = x
    extent[TOP], extent[BOTTOM] = min(extent[TOP], y), max(extent[BOTTOM], y)
    extent[LAST] = pixel


@subroutine
def _measure(layers, ids, of_world, of_instance, extents):
    never_inline()
    for x in range(ids.shape[1]):
        for y in range(ids.shape[0]):
            pixel = x * ids.shape[0] + y
            body = _body_of(ids[y, x, OBJECT_ID], ids[y, x, INSTANCE_ID], of_world, of_instance)
            if body > 0:
                _measure_pixel(extents[body - 1, VISIBLE], x, y, pixel)
            for k in range(layers.shape[2]):
                if layers[y, x, k, 0] < 0:
                    break
                body = _body_of(layers[y, x, k, 0], layers[y, x, k, 1], of_world, of_instance)
                if body > 0:
                    _measure_pixel(extents[body - 1, WHOLE], x, y, pixel)


@device
def _mark_pixel(run, edges, pixel):
    """Adds a pixel to the runs of a mask. run: the number of edges and the end of the last run."""
    at, end = run[0], run[1]
    if end != pixel + 1:
        if end != pixel:
            edges[at] = pixel
            run[0] = at + 2
            at += 2
        edges[at - 1] = pixel + 1
        run[1] = pixel + 1


@subroutine
def _list_runs(layers, ids, of_world, of_instance, runs, edges):
    never_inline()
    for x in range(ids.shape[1]):
        for y in range(ids.shape[0]):
            pixel = x * ids.shape[0] + y
            body = _body_of(ids[y, x, OBJECT_ID], ids[y, x, INSTANCE_ID], of_world, of_instance)
            if body > 0:
                _mark_pixel(runs[body - 1, VISIBLE], edges, pixel)
            for k in range(layers.shape[2]):
                if layers[y, x, k, 0] < 0:
                    break
                body = _body_of(layers[y, x, k, 0], layers[y, x, k, 1], of_world, of_instance)
                if body > 0:
                    _mark_pixel(runs[body - 1, WHOLE], edges, pixel)


@entry
def trace_annotation(scene, stack, camera, top, times, places, hits, normals, ids, layers, counts):
    """Fills the annotation of h rows of pixels from row `top` on.

    times: (h, w, 3) float32, of the shutter, 0 ... 1; rays are those of the second. places: (h, w, 3, 4) float64, where the point
    is at each time, or (h, w, 1, 4) at the second alone: a world point (x, y, z, 1), or if nothing is hit the ray's direction and
    0. hits: (h, w, HIT_COLUMNS) float64, for `locate_points`, or (h, w, 0). normals: (h, w, 3) float32, unit shading normals on
    the viewer's side, 0 without a surface. ids: (h, w, ID_COLUMNS) int32, -1 for none: numbers of object, instance and material;
    instance -1 is the world's own geometry. layers: (h, w, d, 2) int32, the objects and instances that the ray meets, in order,
    each once; d = 0: not traced. counts: (h, w) int32, how many there are, which may exceed d. scene: in the variant for moving
    scenes. stack: from new_stack.
    """
    _annotate(by_reference(scene), stack, camera, top, times, places, hits, normals, ids, layers, counts)


@entry
def locate_points(scene, camera, top, times, hits, places):
    """Computes where the points of a picture are at other times, from their hits; places: (h, w, 1, 4), as above.

    times: (h, w, 2) float32, of the ray and of the place. The other arguments are those of `trace_annotation`.
    """
    _locate(by_reference(scene), camera, top, times, hits, places)


@entry
def trace_occlusion(scene, stack, eye, places, times, occluded):
    """Sets `occluded`, (h, w) uint8, to 1 where a surface lies between a point and the eye.

    eye: three float64. places: (h, w, 4) float64, points with a last column of 1, or directions with 0, which any surface
    occludes. times: (h, w) float32, of the shutter, 0 ... 1. Pixels that are occluded already are not traced.
    """
    _occlude(by_reference(scene), stack, eye, places, times, occluded)


@entry
def measure_masks(layers, ids, of_world, of_instance, extents):
    """Measures the masks of n bodies in one pass over the pixels.

    layers, ids: as of `trace_annotation`. of_world, of_instance: int32, 1 + the index of the body of each object's geometry in
    world space, and of each instance; 0 for none. extents: (n, 2, EXTENT_COLUMNS) int64, for the masks WHOLE and VISIBLE; AREA
    and RUNS are 0 and LAST is -2 before. Runs are of pixels numbered column by column. Other columns are undefined without area.
    """
    _measure(layers, ids, of_world, of_instance, extents)


@entry
def list_runs(layers, ids, of_world, of_instance, runs, edges):
    """Lists the runs of the masks of n bodies: the first pixel of each, and the one after its last.

    runs: (n, 2, 2) int64: where each mask's edges start in `edges`, and -1. edges: int64, two for each run of `measure_masks`.
    The other arguments are those of `measure_masks`.
    """
    _list_runs(layers, ids, of_world, of_instance, runs, edges)
