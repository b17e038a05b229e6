"""Converts Blender's meshes to plain arrays by block copies: a million triangles in well under a second."""

from __future__ import annotations

import ctypes
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from .model import Mesh
from .particles import strands_of
from .smooth_strands import divided, lines_per_segment
from .tubes import MOST_POINTS, tubes

__all__ = ["Corners", "extract", "hair", "particle_hair", "shape", "spans", "stretched"]

F32 = npt.NDArray[np.float32]
I32 = npt.NDArray[np.int32]
MOST_MEASURED = 20_000  # triangles
LEAST_COVERED = 1e-15  # least UV area of a triangle that is measured
TRIANGLE = 12  # bytes


class Corners(NamedTuple):
    """The vertices into which a mesh's face corners were split, recorded so that later shapes of the mesh are split alike."""

    counts: tuple[int, int, int]  # vertices, corners, triangles
    vertex: I32  # of each new vertex, the old one
    corner: I32
    domain: str  # of the normals


def extract(source: Any, key: str, color: str | None = None, all_uvs: bool = False) -> tuple[Mesh, Corners] | None:
    """Converts a bpy.types.Mesh to (Mesh, how its corners were split); returns None if it has no faces.

    key: identifies the mesh in the exported scene. color: name of the colour attribute that multiplies the base colour, or None.
    all_uvs: True to export all UV sets in the mesh's order, instead of two with the active one first.
    """
    source.calc_loop_triangles()
    count = len(source.loop_triangles)
    if not count:
        return None
    corners = _corners(source.loop_triangles)
    vertex_of = _vertex_of(source)
    positions = _positions(source)
    domain = _domain(source)
    uvs = [_uv(layer, len(vertex_of)) for layer in (source.uv_layers if all_uvs else _uv_layers(source))]
    colors, of_corners = _colors(source, color, len(vertex_of)) if color else (None, False)
    split = [*uvs, *([_corner_normals(source)] if domain == "CORNER" else []), *([colors] if of_corners else [])]
    vertex, corner, of_corner = _split_vertices(vertex_of, len(positions), [each for each in split if each is not None])
    mesh = Mesh(key, positions[vertex], _triangles_by_material(source, of_corner[corners].view(np.uint32), count))
    mesh.normals = _normals(source, domain, vertex, corner)
    mesh.uvs = tuple(uv[corner] for uv in uvs)
    if colors is not None:
        mesh.colors = colors[corner if of_corners else vertex]
    return mesh, Corners((len(positions), len(vertex_of), count), vertex, corner, domain)


def hair(source: Any, key: str, like: Corners | None = None) -> tuple[Mesh, Corners] | None:
    """Converts a bpy.types.Curves to a mesh of tubes; returns (Mesh, its Corners), or None without points or with too many.

    key: identifies the mesh in the exported scene. like: the Corners of an earlier conversion, whose division is used.
    """
    count = len(source.points)
    if not 0 < count <= MOST_POINTS:
        return None
    points = _read_attribute(source.points, "position", 3 * count, np.float32).reshape(-1, 3)
    first = np.append(_read_attribute(source.curves, "first_point_index", len(source.curves), np.int32), np.int32(count))
    across = _read_attribute(source.normals, "vector", 3 * count, np.float32).reshape(-1, 3) if _is_elliptic(source) else None
    return _tubes(key, points, _read_attribute(source.points, "radius", count, np.float32), first, like, across)


def _is_elliptic(source: Any) -> bool:
    """Returns True if the cross-section of hair curves may be an ellipse, whose major axis Cycles takes from the normals."""
    material = source.materials[0] if len(source.materials) else None
    tree = None if material is None else material.node_tree
    return tree is not None and any(getattr(node, "model", "") == "HUANG" for node in tree.nodes)


def particle_hair(
    thing: Any, system: Any, for_render: bool, key: str, like: Corners | None = None
) -> tuple[Mesh, Corners] | None:
    """Converts the hair of a particle system to a mesh of tubes, as `hair` does; other arguments as for `strands_of`."""
    found = strands_of(thing, system, for_render)
    return None if found is None else _tubes(key, *found, like)


def _tubes(
    key: str, points: F32, radii: F32, first: I32, like: Corners | None, across: F32 | None = None
) -> tuple[Mesh, Corners]:
    is_alike = like is not None and len(like.vertex) == len(first) - 1
    lines = like.vertex if like is not None and is_alike else lines_per_segment(points, radii, first, MOST_POINTS)
    made = tubes(*divided(points, radii, first, lines), None if across is None else divided(across, radii, first, lines)[0])
    mesh = Mesh(key, made.positions, [(0, made.triangles.astype(np.uint32).ravel())], made.normals, fibres=made.fibres)
    nothing = np.zeros(0, np.int32)
    return mesh, Corners((len(made.positions), len(points), len(made.triangles)), lines, nothing, "POINT")


def shape(source: Any, corners: Corners) -> tuple[F32, F32 | None] | None:
    """Returns positions and normals of a mesh at another time, split as recorded in `corners`.

    Returns None if its topology has changed.
    """
    source.calc_loop_triangles()
    if (len(source.vertices), len(source.loops), len(source.loop_triangles)) != corners.counts:
        return None
    return _positions(source)[corners.vertex], _normals(source, corners.domain, corners.vertex, corners.corner)


def stretched(mesh: Mesh, uv_set: int) -> tuple[float, float] | None:
    """Returns the mean length of the mesh's surface per UV unit, across and up; None if the UV set does not exist."""
    if uv_set >= len(mesh.uvs):
        return None
    corners = np.concatenate([part for _, part in mesh.parts]).reshape(-1, 3)[:MOST_MEASURED]
    return spans(mesh.positions[corners].astype(np.float64), mesh.uvs[uv_set][corners].astype(np.float64))


def spans(corners: npt.NDArray[np.float64], uv: npt.NDArray[np.float64]) -> tuple[float, float] | None:
    """Returns the mean length of triangles per UV unit, across and up the image, weighted by area; None if undefined.

    corners: (T, 3, 3), positions of the triangles' corners. uv: (T, 3, 2).
    """
    p, q = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    covered = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    area = np.linalg.norm(np.cross(p, q), axis=1)
    is_sound = (np.abs(covered) > LEAST_COVERED) & (area > 0)
    if not is_sound.any():
        return None
    p, q, a, b, covered, area = (each[is_sound] for each in (p, q, a, b, covered, area))
    across = np.linalg.norm(p * b[:, 1:] - q * a[:, 1:], axis=1) / np.abs(covered)
    up = np.linalg.norm(q * a[:, :1] - p * b[:, :1], axis=1) / np.abs(covered)
    return float(np.average(across, weights=area)), float(np.average(up, weights=area))


def _read_attribute(collection: Any, name: str, count: int, kind: Any) -> npt.NDArray[Any]:
    found = np.empty(count, kind)
    collection.foreach_get(name, found)
    return found


def _positions(source: Any) -> F32:
    """Returns the vertex positions, (V, 3), copied as a block from Blender's array."""
    own = source.attributes.get("position")
    if own is None:
        return _read_attribute(source.vertices, "co", 3 * len(source.vertices), np.float32).reshape(-1, 3)
    return _read_attribute(own.data, "vector", 3 * len(source.vertices), np.float32).reshape(-1, 3)


def _corners(triangles: Any) -> I32:
    """Returns the corner indices of all triangles, copied as a block if Blender's memory layout allows it.

    Blender's own function takes a tenth of a second for a million triangles.
    """
    count = len(triangles)
    start = triangles[0].as_pointer()
    if triangles[count - 1].as_pointer() - start != TRIANGLE * (count - 1):
        return _read_attribute(triangles, "loops", 3 * count, np.int32)
    block = (ctypes.c_int32 * (3 * count)).from_address(start)
    found = np.frombuffer(block, np.int32).copy()
    few = [0, count // 2, count - 1]
    if any(tuple(triangles[i].loops) != tuple(found[3 * i : 3 * i + 3]) for i in few):
        return _read_attribute(triangles, "loops", 3 * count, np.int32)
    return found


def _vertex_of(source: Any) -> I32:
    """Returns the vertex index of each corner, copied as a block from Blender's array."""
    own = source.attributes.get(".corner_vert")
    if own is None:
        return _read_attribute(source.loops, "vertex_index", len(source.loops), np.int32)
    return _read_attribute(own.data, "value", len(source.loops), np.int32)


def _domain(source: Any) -> str:
    """Returns the domain of a mesh's normals: FACE if all faces are flat, POINT if all are smooth, else CORNER."""
    if not hasattr(source, "normals_domain"):  # before Blender 4.1
        source.calc_normals_split()
        return "CORNER"
    return str(source.normals_domain)


def _corner_normals(source: Any) -> F32:
    count = 3 * len(source.loops)
    if hasattr(source, "corner_normals"):
        return _read_attribute(source.corner_normals, "vector", count, np.float32).reshape(-1, 3)
    return _read_attribute(source.loops, "normal", count, np.float32).reshape(-1, 3)


def _normals(source: Any, domain: str, vertex: I32, corner: I32) -> F32 | None:
    if domain == "FACE":
        return None
    if domain == "POINT":
        return _read_attribute(source.vertex_normals, "vector", 3 * len(source.vertices), np.float32).reshape(-1, 3)[vertex]
    return _corner_normals(source)[corner]


def _uv_layers(source: Any) -> list[Any]:
    """Returns up to two UV layers: the one active for rendering, then the first other one."""
    layers = list(source.uv_layers)
    layers.sort(key=lambda layer: not layer.active_render)
    return layers[:2]


def _uv(layer: Any, count: int) -> F32:
    uv = _read_attribute(
        layer.uv if hasattr(layer, "uv") else layer.data, "vector" if hasattr(layer, "uv") else "uv", 2 * count, np.float32
    )
    uv = uv.reshape(-1, 2)
    uv[:, 1] = 1 - uv[:, 1]
    return uv


def _colors(source: Any, name: str, count: int) -> tuple[F32 | None, bool]:
    """Returns (values of the colour attribute, (N, 4) linear, or None; whether it has a value per face corner)."""
    known = source.color_attributes
    if name:
        found = known.get(name)
    else:
        index = known.render_color_index
        found = known[index] if 0 <= index < len(known) else None
    if found is None or found.domain not in ("POINT", "CORNER"):
        return None, False
    of_corners = found.domain == "CORNER"
    rows = count if of_corners else len(source.vertices)
    return _read_attribute(found.data, "color", 4 * rows, np.float32).reshape(-1, 4), of_corners


def _split_vertices(vertex_of: I32, vertices: int, attributes: list[F32]) -> tuple[I32, I32, I32]:
    """Splits vertices for glTF, which has no attributes per corner: adds a vertex for each corner whose attributes differ.

    attributes: the corners' attributes, (C, n) each. Returns for each new vertex its old vertex and its corner, and for each
    corner its new vertex.
    """
    corners = np.arange(len(vertex_of), dtype=np.int32)
    first = np.zeros(vertices, np.int32)
    first[vertex_of[::-1]] = corners[::-1]
    used = np.zeros(vertices, bool)
    used[vertex_of] = True
    differs = np.zeros(len(vertex_of), bool)
    beside = first[vertex_of]
    for values in attributes:
        for column in _columns(values):
            differs |= column != column[beside]
    number = np.cumsum(used, dtype=np.int32) - 1
    kept = np.flatnonzero(used).astype(np.int32)
    more = corners[differs]
    of_corner = number[vertex_of]
    of_corner[more] = len(kept) + np.arange(len(more), dtype=np.int32)
    return np.concatenate([kept, vertex_of[more]]), np.concatenate([first[kept], more]), of_corner


def _columns(values: F32) -> list[npt.NDArray[Any]]:
    """Returns the columns of an array as integers with the same bits, for comparing its rows.

    If the array has an even number of columns, each integer combines two of them.
    """
    if values.shape[1] % 2:
        return [np.ascontiguousarray(column) for column in values.view(np.uint32).T]
    return [np.ascontiguousarray(column) for column in np.ascontiguousarray(values).view(np.uint64).T]


def _triangles_by_material(source: Any, corners: npt.NDArray[np.uint32], count: int) -> list[tuple[int, npt.NDArray[np.uint32]]]:
    """Returns (material slot, its triangles' corner indices) for each slot that has triangles."""
    if len(source.materials) < 2:
        return [(0, corners)]
    slots = _read_attribute(source.loop_triangles, "material_index", count, np.int32)
    found = np.unique(slots)
    if len(found) == 1:
        return [(int(found[0]), corners)]
    triangles = corners.reshape(-1, 3)
    return [(int(slot), triangles[slots == slot].ravel()) for slot in found]
