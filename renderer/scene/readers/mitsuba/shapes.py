"""Adds shapes with their materials to the world, and instances of shape groups."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from renderer.errors import SceneError
from renderer.scene.description import Instance, Mesh, SceneDescription, Sphere
from renderer.scene.readers.curve_files import mesh_of_curves
from renderer.scene.readers.expansion_limits import check_expansion
from renderer.scene.readers.height_maps import spans_of
from renderer.scene.readers.mitsuba.bsdfs import Bsdfs
from renderer.scene.readers.mitsuba.document import Document, Element
from renderer.scene.readers.mitsuba.meshes import FORMULAS, MESH_FILES, file_of, flipped, meshes_of, wind_to_normals
from renderer.scene.readers.mitsuba.parametric_shapes import sphere
from renderer.scene.readers.mitsuba.values import Matrix
from renderer.sentences import Sentence

__all__ = ["Shapes"]

_CURVES = {"bsplinecurve": "bspline", "linearcurve": "linear"}  # bases
_MAX_NESTED = 16


class Shapes:
    """Adds shapes to a description."""

    def __init__(self, document: Document, bsdfs: Bsdfs, description: SceneDescription) -> None:
        self._document, self._bsdfs, self._description = document, bsdfs, description
        # Meshes of non-uniformly scaled spheres, by material and orientation.
        self._balls: dict[tuple[int, bool], int] = {}
        self._meshes: dict[int, list[tuple[int, Matrix]]] = {}  # (mesh index, transform) by shape

    def check_expansion(self) -> None:
        """Raises SceneError if nested groups expand to too many shapes. Called before any shape is added."""
        check_expansion(self._document.scene, _contained_shapes, self._document.main)

    def add(self, shape: Element, place: Matrix | None = None, depth: int = 0) -> None:
        """Adds a shape to the description.

        place: (4, 4) transform of the shape group that contains the shape; depth: nesting level of the shape.
        Raises SceneError if the shape is invalid or nested too deeply.
        """
        if depth > _MAX_NESTED:
            raise SceneError(
                Sentence(
                    "mitsuba-shape-nested-too-deep",
                    "{file}: {what} is nested too deeply; flatten it",
                    file=shape.file,
                    what=shape.description,
                )
            )
        shape.mark_used()
        if shape.type == "shapegroup":
            return  # added by its instances
        world = (np.eye(4) if place is None else place) @ shape.matrix()
        if not np.isfinite(world).all():
            raise SceneError(
                Sentence(
                    "mitsuba-transform-not-finite",
                    "{file}: {what} has a transform with numbers that are not finite; correct it",
                    file=shape.file,
                    what=shape.description,
                )
            )
        if shape.type == "instance":
            for group in shape.children_of("shape"):
                group.mark_used()
                for part in group.children_of("shape"):
                    self.add(part, world @ group.matrix(), depth + 1)
        elif shape.type == "merge":
            for part in shape.children_of("shape"):
                self.add(part, world, depth + 1)
        elif shape.type == "sphere":
            self._sphere(shape, world)
        elif shape.type in MESH_FILES or shape.type in FORMULAS:
            self._mesh(shape, world)
        elif shape.type in _CURVES:
            self._curves(shape, world)
        else:
            self._document.ignore(
                Sentence("shape-type-unsupported", "{what} is not supported as a shape: it is left out", what=shape.description)
            )

    def _mesh(self, shape: Element, world: Matrix) -> None:
        if id(shape) not in self._meshes:
            found = []
            for mesh, place in self._meshes_with_materials(shape, world):
                material = mesh.material
                if material in self._bsdfs.inside_out:
                    mesh = flipped(mesh)
                if material in self._bsdfs.bumpy:
                    mesh = replace(mesh, tangents=None)  # bump maps follow the image's own axes
                if any(shape.children_of("emitter")):
                    mesh = wind_to_normals(mesh)
                self._description.meshes.append(mesh)
                found.append((len(self._description.meshes) - 1, place))
            self._meshes[id(shape)] = found
        for number, place in self._meshes[id(shape)]:
            self._description.instances.append(Instance(number, world @ place, name=shape.id))

    def _meshes_with_materials(self, shape: Element, world: Matrix) -> list[tuple[Mesh, Matrix]]:
        """Returns the shape's meshes with their materials, and with colours if a material uses a mesh attribute."""
        found = meshes_of(shape, self._document)
        numbers = [self._bsdfs.material(shape, _spans(mesh, world @ place)) for mesh, place in found]
        attribute = next((self._bsdfs.attributes[number] for number in numbers if number in self._bsdfs.attributes), "")
        if attribute and (attribute != "vertex_color" or any(mesh.colors is None for mesh, _ in found)):
            found = meshes_of(shape, self._document, attribute)
            if any(mesh.colors is None for mesh, _ in found):
                self._document.ignore(
                    Sentence(
                        "mitsuba-mesh-attribute-missing",
                        "{what}: its mesh has no attribute {attribute}: it is rendered in one colour",
                        what=shape.description,
                        attribute=attribute[:60],
                    )
                )
        for number, (mesh, _) in zip(numbers, found, strict=True):
            mesh.material = number
            mesh.colors = mesh.colors if attribute else None
        return found

    def _curves(self, shape: Element, world: Matrix) -> None:
        name = file_of(shape, self._document)
        material = self._bsdfs.material(shape)
        fibres = self._description.materials[material].kind == "hair"
        mesh = mesh_of_curves(_CURVES[shape.type], self._document.files.read(name), name, world, fibres)
        mesh.material = material
        self._description.meshes.append(mesh)
        self._description.instances.append(Instance(len(self._description.meshes) - 1, np.eye(4), name=shape.id))

    def _sphere(self, shape: Element, world: Matrix) -> None:
        center, radius = np.asarray(shape.get("center", (0.0, 0.0, 0.0)), float), shape.number("radius", 1.0)
        scales = np.linalg.norm(world[:3, :3], axis=0)
        is_round = np.allclose(world[:3, :3].T @ world[:3, :3], scales[0] ** 2 * np.eye(3), rtol=1e-4, atol=1e-4 * scales[0] ** 2)
        place = np.diag([radius, radius, radius, 1.0])
        place[:3, 3] = center
        material = self._bsdfs.material(shape, _spans(_unit_ball(), world @ place))
        is_flipped = shape.boolean("flip_normals", False) != (material in self._bsdfs.inside_out)
        if is_round and not is_flipped and not self._needs_sphere_uvs(material):
            x, y, z = (world @ np.array([*center, 1.0]))[:3]
            self._description.spheres.append(
                Sphere((float(x), float(y), float(z)), float(radius * scales[0]), material, shape.id or "sphere")
            )
            return
        number = self._ball(material, is_flipped)
        self._description.instances.append(Instance(number, world @ place, name=shape.id))

    def _needs_sphere_uvs(self, material: int) -> bool:
        """Returns True if a material has a texture or anisotropy, which need Mitsuba's UVs on a sphere."""
        made = self._description.materials[material]
        return made.anisotropy > 0 or any(name.endswith("_texture") and value is not None for name, value in vars(made).items())

    def _ball(self, material: int, is_flipped: bool) -> int:
        key = material, is_flipped
        if key not in self._balls:
            ball: Mesh = sphere("sphere")
            if is_flipped:
                ball.triangles = np.ascontiguousarray(ball.triangles[:, ::-1])
                ball.normals = None if ball.normals is None else -ball.normals
            ball.material = material
            self._description.meshes.append(ball)
            self._balls[key] = len(self._description.meshes) - 1
        return self._balls[key]


@functools.cache
def _unit_ball() -> Mesh:
    """Returns a sphere mesh for measuring UV spans; it is not rendered."""
    return sphere("sphere")


def _spans(mesh: Mesh, place: Matrix) -> Callable[[], tuple[float, float] | None]:
    return lambda: spans_of(mesh, 0, place[:3, :3])


def _contained_shapes(thing: Element) -> Iterator[Element]:
    """Yields the shapes that a scene, an instance or a merged shape contains."""
    if thing.type == "instance":
        for group in thing.children_of("shape"):
            yield from group.children_of("shape")
    elif thing.tag == "scene" or thing.type == "merge":
        yield from (shape for shape in thing.children_of("shape") if shape.type != "shapegroup")
