"""Reads formats by trimesh: text STL and Collada, with scene graph, materials and textures."""

from __future__ import annotations

import io
import logging
import re
from dataclasses import replace
from pathlib import PurePosixPath
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh
from PIL import Image, PngImagePlugin

from renderer.confine.faults import is_of_machine
from renderer.errors import SceneError
from renderer.library_messages import library_message
from renderer.scene.description import F32, Instance, Material, Mesh, SceneDescription, Vec3
from renderer.scene.files import SceneFiles
from renderer.scene.normals import smoothed
from renderer.scene.origin import in_exact_type
from renderer.scene.readers.colors import vertex_colors
from renderer.scene.readers.points import add_points
from renderer.scene.readers.polygon_meshes import triangulated, without_bad_vertices
from renderer.scene.readers.up_axis import X_UP, Z_UP
from renderer.scene.readers.xml import refuse_entities
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence

__all__ = ["read", "read_data"]


logging.getLogger("trimesh").setLevel(logging.CRITICAL)  # our own errors and warnings report damaged files


def read(files: SceneFiles, main: str, description: SceneDescription) -> None:
    """Adds the file's scene to the description. Raises SceneError if the file is damaged."""
    read_data(files.read(main), PurePosixPath(main).suffix.lower(), files, main, description)


def read_data(data: bytes, suffix: str, files: SceneFiles, main: str, description: SceneDescription) -> None:
    """Adds the scene of a file, given as bytes, to the description. suffix: of the file's name.

    Raises SceneError if it is damaged.
    """
    if suffix == ".dae":
        refuse_entities(data, main)
    shelf = TextureShelf(description, files)
    resolver = _Resolver(files, main, shelf)
    try:
        scene = trimesh.load_scene(io.BytesIO(data), file_type=suffix[1:], resolver=resolver, process=False, skip_materials=False)
    except MemoryError:
        raise
    except Exception as error:  # trimesh's readers raise nearly every type on damaged files
        if is_of_machine(error):
            raise
        raise SceneError(
            Sentence(
                "file-damaged-or-misnamed",
                "{name} is damaged or not a {format} file. Export it again ({reason})",
                name=main,
                format=suffix,
                reason=library_message(error),
            )
        ) from error
    _add(scene, main, _upright_transform(suffix, data), shelf, description)


def _add(scene: Any, main: str, upright: npt.NDArray[np.float64], shelf: TextureShelf, description: SceneDescription) -> None:
    numbers: dict[str, int] = {}
    materials: dict[tuple[int, Any], int] = {}
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        geometry = scene.geometry[name]
        loose = _points(geometry)
        if loose is not None:
            _add_points(loose, main, upright @ np.asarray(transform, np.float64), geometry, shelf, description)
            continue
        if not isinstance(geometry, trimesh.Trimesh) or len(geometry.faces) == 0:
            shelf.warn(
                Sentence(
                    "trimesh-part-without-triangles",
                    "{file}: {name} has no triangles and is left out.",
                    file=main,
                    name=str(name)[:80],
                )
            )
            continue
        if name not in numbers:
            mesh = _mesh(str(name), geometry, main, shelf)
            source = getattr(geometry.visual, "material", None)
            key = (id(source), getattr(geometry.visual, "kind", None))
            if key not in materials:
                description.materials.append(_material(geometry, shelf))
                materials[key] = len(description.materials) - 1
            mesh.material = materials[key]
            description.meshes.append(smoothed(mesh))
            numbers[name] = len(description.meshes) - 1
        description.instances.append(Instance(numbers[name], upright @ np.asarray(transform, np.float64), name=str(name)))


def _points(geometry: Any) -> F32 | None:
    """Returns the (P, 3) points of a point cloud; None if the geometry has faces."""
    if isinstance(geometry, trimesh.PointCloud) or (isinstance(geometry, trimesh.Trimesh) and len(geometry.faces) == 0):
        points = in_exact_type(np.asarray(geometry.vertices))
        return points if points.ndim == 2 and points.shape[1] == 3 and len(points) else None
    return None


def _add_points(
    points: F32, main: str, place: npt.NDArray[np.float64], geometry: Any, shelf: TextureShelf, description: SceneDescription
) -> None:
    colors = getattr(geometry, "colors", None)
    if colors is None and getattr(geometry.visual, "kind", None) == "vertex":
        colors = geometry.visual.vertex_colors
    shown = np.asarray(colors, np.uint8) if colors is not None and len(colors) == len(points) else None
    add_points(points, shown, place, main, description, shelf)


def _mesh(name: str, geometry: Any, main: str, shelf: TextureShelf) -> Mesh:
    positions = in_exact_type(np.asarray(geometry.vertices))
    triangles = np.asarray(geometry.faces, np.int64)
    whole = triangulated(np.full(len(triangles), 3), triangles.reshape(-1), positions, main, shelf).face
    triangles = triangles[whole]
    mesh = Mesh(name, positions, triangles.astype(np.int32))
    # trimesh computes missing normals; only those of the file are in its cache.
    own = geometry._cache.cache.get("vertex_normals")
    mesh.normals = None if own is None or len(own) != len(positions) else np.asarray(own, np.float32)
    uvs = getattr(geometry.visual, "uv", None)
    if uvs is not None:
        uvs = np.asarray(uvs, np.float32)
        if uvs.ndim == 2 and len(uvs) == len(positions) and uvs.shape[1] >= 2:
            mesh.uvs = np.ascontiguousarray(np.stack([uvs[:, 0], 1 - uvs[:, 1]], axis=1))  # trimesh: v from the lower edge
    return without_bad_vertices(_with_colors(mesh, geometry.visual, whole))


def _with_colors(mesh: Mesh, visual: Any, whole: npt.NDArray[np.int64]) -> Mesh:
    kind = getattr(visual, "kind", None)
    if kind == "vertex" and len(visual.vertex_colors) == len(mesh.positions):
        return replace(mesh, colors=vertex_colors(np.asarray(visual.vertex_colors)))
    if kind != "face" or len(visual.face_colors) <= whole.max(initial=-1):
        return mesh
    # Faces of different colours share no vertex.
    corners = mesh.triangles.reshape(-1)

    def pick(values: F32 | None) -> F32 | None:
        return None if values is None else values[corners]

    colors = vertex_colors(np.repeat(np.asarray(visual.face_colors)[whole], 3, axis=0))
    own = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
    return Mesh(mesh.name, mesh.positions[corners], own, pick(mesh.normals), pick(mesh.uvs), colors=colors)


def _material(geometry: Any, shelf: TextureShelf) -> Material:
    visual = geometry.visual
    source = getattr(visual, "material", None)
    if source is None:
        return Material(base_color=(1.0, 1.0, 1.0)) if getattr(visual, "kind", None) in ("vertex", "face") else Material()
    material = Material(str(getattr(source, "name", None) or "default"))
    image = getattr(source, "baseColorTexture", None) or getattr(source, "image", None)
    material.base_color_texture = _texture(image, shelf)
    factor = getattr(source, "baseColorFactor", None)
    if factor is not None:
        material.base_color = _color(factor)
    elif material.base_color_texture is not None:
        material.base_color = (1.0, 1.0, 1.0)
    roughness, metallic = getattr(source, "roughnessFactor", None), getattr(source, "metallicFactor", None)
    if (roughness is not None and roughness < 1) or metallic:
        material.kind = "metallic_roughness"
        material.roughness = float(np.clip(1.0 if roughness is None else roughness, 0, 1))
        material.metallic = float(np.clip(metallic or 0.0, 0, 1))
    emission = getattr(source, "emissiveFactor", None)
    if emission is not None:
        material.emission = _color(emission)
        material.emission_texture = _texture(getattr(source, "emissiveTexture", None), shelf)
    return material


def _color(values: Any) -> Vec3:
    found = np.asarray(values)
    scale = 255.0 if found.dtype == np.uint8 else 1.0
    r, g, b = (float(c) for c in np.nan_to_num(np.clip(found[:3].astype(np.float64) / scale, 0, 1)))
    return r, g, b


def _upright_transform(suffix: str, data: bytes) -> npt.NDArray[np.float64]:
    if suffix == ".stl":
        return Z_UP
    said = re.search(rb"<up_axis>\s*([XYZ])_UP", data[:100_000]) if suffix == ".dae" else None
    return {b"Z": Z_UP, b"X": X_UP}.get(said.group(1) if said else b"Y", np.eye(4))


def _texture(image: Any, shelf: TextureShelf) -> int | None:
    name = getattr(image, "info", {}).get(_Resolver.KEY)
    return None if name is None else shelf.texture(shelf.image_file(name))


class _Resolver(trimesh.resolvers.Resolver):
    """Gives trimesh, for each texture that it requests, a one-pixel image that contains the texture's file name.

    Textures are then decoded by renderer/image/read.py, with its limits, rather than by trimesh.
    """

    KEY = "rayfarm-file"

    def __init__(self, files: SceneFiles, main: str, shelf: TextureShelf) -> None:
        self._files, self._main, self._shelf = files, main, shelf

    def get(self, key: str) -> bytes:
        name = self._files.resolve_uri(str(key), self._main)
        if name is None:
            self._shelf.warn_of_missing(str(key), self._main)
            raise FileNotFoundError(key)
        text = PngImagePlugin.PngInfo()
        text.add_itxt(self.KEY, name)
        picture = io.BytesIO()
        Image.new("RGB", (1, 1)).save(picture, "PNG", pnginfo=text)
        return picture.getvalue()

    def write(self, name: str, data: Any) -> None:
        raise PermissionError("a scene is only read")

    def namespaced(self, namespace: str) -> _Resolver:
        return self

    def keys(self) -> list[str]:
        return []
