"""Triangle meshes and bilinear patches in object space; v of the UVs is measured from the top."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import PurePosixPath
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.scene.description import Mesh, SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.normals import face_normals, smoothed
from renderer.scene.origin import in_exact_type
from renderer.scene.readers import ply
from renderer.scene.readers.pbrt.expansion_limits import TriangleBudget
from renderer.scene.readers.pbrt.loop import subdivided
from renderer.scene.readers.pbrt.notes import Notes
from renderer.scene.readers.pbrt.parameters import Parameters
from renderer.scene.readers.pbrt.statements import unpacked
from renderer.sentences import Sentence

__all__ = ["MESHES", "flipped", "mesh_of", "with_uvs"]

MESHES = ("trianglemesh", "plymesh", "bilinearmesh", "loopsubdiv")
_NORMALS = rb"\A[^\0]{0,20000}?property\s+\w+\s+nx\b"
_EVERY_EDGE = 181.0
_PATCH = 8  # quads per side of a curved patch
_FLAT = 1e-5


def mesh_of(source: Parameters, files: SceneFiles, notes: Notes, growth: TriangleBudget) -> Mesh:
    """Returns the mesh of a shape. Raises SceneError if the shape is invalid or its file is missing.

    growth: limits subdivision.
    """
    if source.type == "trianglemesh":
        return _triangles(source, notes)
    if source.type == "plymesh":
        return _of_file(source, files, notes)
    if source.type == "bilinearmesh":
        return _patches(source, notes, growth)
    return _subdivided(source, notes, growth)


def _triangles(source: Parameters, notes: Notes) -> Mesh:
    points = _points(source)
    indices = _indices(source, len(points), 3, None if len(points) != 3 else np.arange(3))
    mesh = Mesh("trianglemesh", in_exact_type(points), indices.astype(np.int32))
    mesh.normals, mesh.uvs = _vectors(source, "N", len(points)), _uvs(source, len(points))
    if source.get("S") is not None:
        notes.add(
            source.place,
            Sentence("pbrt-mesh-tangents-ignored", "Tangents of a mesh (S) are ignored: they follow from its UVs"),
        )
    return _facing(mesh)


def _of_file(source: Parameters, files: SceneFiles, notes: Notes) -> Mesh:
    wanted = source.text("filename")
    name = files.find(wanted, source.place.file)
    if name is None:
        raise source.place.error(
            Sentence(
                "file-missing",
                "{name} is not among the files; add it",
                name=repr(PurePosixPath(wanted).name[:120]),
            )
        )
    part: SceneDescription = files.get_or_make(("ply", name), lambda: _read(files, name))
    mesh = _single_mesh(part)
    return replace(_facing(mesh))


def _read(files: SceneFiles, name: str) -> SceneDescription:
    data = files.read(name)
    if name.lower().endswith(".gz"):
        data = unpacked(data, name)

    part = SceneDescription(name=name)
    ply.read_data(data, files, name, part, has_pictures=False)
    if re.search(_NORMALS, data) is None:
        part.meshes = [replace(mesh, normals=None) for mesh in part.meshes]
    return part


def _single_mesh(part: SceneDescription) -> Mesh:
    mesh = part.meshes[0] if part.meshes else Mesh("plymesh", np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32))
    return replace(mesh, colors=None, material=0)


def _patches(source: Parameters, notes: Notes, growth: TriangleBudget) -> Mesh:
    points = _points(source)
    corners = _indices(source, len(points), 4, None if len(points) != 4 else np.arange(4))
    normals, uvs = _vectors(source, "N", len(points)), _uvs(source, len(points))
    if source.text("emissionfilename"):
        notes.add(
            source.place,
            Sentence(
                "pbrt-emission-texture-ignored",
                "emissionfilename of a bilinearmesh is ignored: it emits evenly",
            ),
        )
    quads = points[corners]  # (Q, 4, 3): 00, 10, 01, 11
    cross = np.cross(quads[:, 1] - quads[:, 0], quads[:, 2] - quads[:, 0])
    away = np.abs(np.einsum("qc,qc->q", cross, quads[:, 3] - quads[:, 0]))
    size = np.linalg.norm(quads[:, 3] - quads[:, 0], axis=1) * np.linalg.norm(cross, axis=1)
    skew = quads[:, 3] - quads[:, 1] - quads[:, 2] + quads[:, 0]  # 0 for parallelograms, whose UVs are exact with two triangles
    even = np.linalg.norm(skew, axis=1) <= _FLAT * np.linalg.norm(quads[:, 3] - quads[:, 0], axis=1)
    steps = 1 if (away <= _FLAT * size).all() and (even.all() or uvs is None) else _PATCH
    while steps > 1 and 2 * steps * steps * len(corners) > growth.triangles_left:
        steps //= 2
    growth.add(2 * (steps * steps - 1) * len(corners))
    side = np.linspace(0, 1, steps + 1)
    v, u = np.meshgrid(side, side, indexing="ij")
    weights = np.stack([(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v], axis=-1).reshape(-1, 4)
    own = np.stack([u, 1 - v], axis=-1).reshape(-1, 2)

    def interpolate(values: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
        return np.einsum("sk,qkx->qsx", weights, values[corners].astype(float)).reshape(-1, values.shape[1])

    row = steps + 1
    at = (np.arange(steps)[:, None] * row + np.arange(steps)).reshape(-1)
    one = np.concatenate([np.stack([at, at + 1, at + row + 1], 1), np.stack([at, at + row + 1, at + row], 1)])
    triangles = (one[None] + (np.arange(len(corners)) * row * row)[:, None, None]).reshape(-1, 3)
    mesh = Mesh("bilinearmesh", in_exact_type(interpolate(points)), triangles.astype(np.int32))
    mesh.uvs = np.tile(own, (len(corners), 1)).astype(np.float32) if uvs is None else interpolate(uvs).astype(np.float32)
    mesh.normals = None if normals is None else interpolate(normals).astype(np.float32)
    if normals is None and steps > 1:
        mesh = smoothed(mesh, _EVERY_EDGE)
    return _facing(mesh)


def _subdivided(source: Parameters, notes: Notes, growth: TriangleBudget) -> Mesh:
    points = _points(source)
    triangles = _indices(source, len(points), 3, None)
    wanted = max(source.integer("levels", source.integer("nlevels", 3)), 0)
    levels = min(wanted, 16)
    while levels and len(triangles) * 4**levels > growth.triangles_left:
        levels -= 1
    growth.add(len(triangles) * (4**levels - 1))
    if levels < wanted:
        notes.add(
            source.place,
            Sentence(
                "pbrt-subdivision-limited",
                "{source} is subdivided {levels} times in place of {asked}, to limit its size",
                source=source,
                levels=levels,
                asked=wanted,
            ),
        )
    fine, faces = subdivided(points, triangles, levels)
    mesh = Mesh("loopsubdiv", in_exact_type(fine), faces.astype(np.int32))
    return flipped(smoothed(mesh, _EVERY_EDGE))  # pbrt's normals are on the clockwise side


def flipped(mesh: Mesh) -> Mesh:
    """Returns the mesh with reversed winding and negated normals."""
    normals = None if mesh.normals is None else -mesh.normals
    return replace(mesh, triangles=np.ascontiguousarray(mesh.triangles[:, ::-1]), normals=normals)


def with_uvs(mesh: Mesh) -> Mesh:
    """Returns the mesh with UVs; if it has none, with pbrt's default (0, 0), (1, 0), (1, 1) for each triangle."""
    if mesh.uvs is not None:
        return mesh
    corners = mesh.triangles.reshape(-1)
    uvs = np.tile(np.array([(0, 1), (1, 1), (1, 0)], np.float32), (len(mesh.triangles), 1))
    normals = None if mesh.normals is None else mesh.normals[corners]
    own = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
    return replace(mesh, positions=mesh.positions[corners], triangles=own, normals=normals, uvs=uvs)


def _facing(mesh: Mesh) -> Mesh:
    """Returns the mesh with each triangle wound to face the same side as its vertex normals."""
    if mesh.normals is None or not len(mesh.triangles):
        return mesh
    along = np.einsum("tc,tc->t", face_normals(mesh.positions, mesh.triangles), mesh.normals[mesh.triangles].sum(axis=1))
    if not (along < 0).any():
        return mesh
    triangles = np.where((along < 0)[:, None], mesh.triangles[:, ::-1], mesh.triangles)
    return replace(mesh, triangles=np.ascontiguousarray(triangles))


def _points(source: Parameters) -> npt.NDArray[np.float64]:
    found = source.numbers("P", "point3", "point")
    if found is None or not len(found):
        raise source.place.error(
            Sentence("pbrt-mesh-points-missing", '{source} has no points; give them as "point3 P" [ ... ]', source=source)
        )
    return found


def _indices(source: Parameters, count: int, corners: int, default: npt.NDArray[np.int64] | None) -> npt.NDArray[np.int64]:
    found = source.numbers("indices", "integer")
    if found is None:
        if default is None:
            raise source.place.error(
                Sentence(
                    "pbrt-mesh-indices-missing",
                    '{source} has no indices; give them as "integer indices" [ ... ]',
                    source=source,
                )
            )
        found = default.astype(float)
    if len(found) % corners or not len(found):
        raise source.place.error(
            Sentence(
                "pbrt-mesh-index-count-wrong",
                "{source} has {count} indices; their number must be a multiple of {multiple}",
                source=source,
                count=len(found),
                multiple=corners,
            )
        )
    if found.min() < 0 or found.max() >= count:
        worst = found.max() if found.max() >= count else found.min()
        raise source.place.error(
            Sentence(
                "pbrt-mesh-index-invalid",
                "{source} has the index {index}, but only {count} points",
                source=source,
                index=f"{worst:.0f}",
                count=count,
            )
        )
    return found.astype(np.int64).reshape(-1, corners)


def _vectors(source: Parameters, name: str, count: int) -> npt.NDArray[np.float32] | None:
    found = source.numbers(name, "normal", "normal3", "vector", "vector3")
    if found is None:
        return None
    if len(found) != count:
        raise source.place.error(
            Sentence(
                "pbrt-mesh-value-count-wrong",
                "{source} has {found} values of {name} for {count} points",
                source=source,
                found=len(found),
                name=name,
                count=count,
            )
        )
    return found.astype(np.float32)


def _uvs(source: Parameters, count: int) -> npt.NDArray[np.float32] | None:
    found = source.numbers("uv", "point2", "float")
    if found is None:
        found = source.numbers("st", "point2", "float")
    if found is None:
        return None
    if found.size != 2 * count:
        raise source.place.error(
            Sentence(
                "pbrt-mesh-uv-count-wrong",
                "{source} has {found} values of uv for {count} points",
                source=source,
                found=found.size // 2,
                count=count,
            )
        )
    pairs = found.reshape(-1, 2)
    return np.column_stack([pairs[:, 0], 1 - pairs[:, 1]]).astype(np.float32)
