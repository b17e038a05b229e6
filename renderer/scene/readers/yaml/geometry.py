"""Reads the shapes of a scene file: built-in shapes, mesh files, and groups."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import PurePosixPath
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.bvh.layout import RAY_KINDS
from renderer.formats import MESH_FORMATS
from renderer.scene.animation import Clip, Moment
from renderer.scene.description import Instance, Material, Mesh, SceneDescription, Sphere
from renderer.scene.files import SceneFiles
from renderer.scene.geometry import MAX_TRIANGLES
from renderer.scene.material import with_visibility
from renderer.scene.matrices import product
from renderer.scene.merge import merge
from renderer.scene.normals import smoothed
from renderer.scene.origin import in_exact_type
from renderer.scene.readers import shapes
from renderer.scene.readers.by_format import read_file
from renderer.scene.readers.curve_files import mesh_of_curves
from renderer.scene.readers.yaml import transforms
from renderer.scene.readers.yaml.keys import AnimatedPaths
from renderer.scene.readers.yaml.lines import Path, Yaml
from renderer.scene.readers.yaml.values import vec3
from renderer.scene.subdivision.meshes import subdivided
from renderer.scene.subdivision.polygons import Faces
from renderer.sentences import Sentence

__all__ = ["Shapes"]

Matrix = transforms.Matrix
Place = tuple[str, Matrix]  # name and transform

# Fields that may be animated without changing the mesh.
_PLACEMENT_FIELDS = {"name", "transform", "instances", "shapes", "material", "center", "radius", "guide", "visible_to"}
MAX_PLACES = 1_000_000  # instances of shapes; nested groups could expand to billions


class Shapes:
    """Adds a scene file's shapes to a description. materials: the description's material indices by name."""

    def __init__(
        self,
        document: Yaml,
        files: SceneFiles,
        description: SceneDescription,
        materials: dict[str, int],
        moment: Moment,
        moving: AnimatedPaths,
    ) -> None:
        self._document, self._files, self._description, self._materials = document, files, description, materials
        self._moving = moving
        self._restless = {number for name, number in materials.items() if self._has_animated_surface(name)}
        self._moment = moment
        self._plain: int | None = None
        self._hidden_copies: dict[tuple[int, frozenset[str]], int] = {}
        self._parts: dict[
            tuple[str, str | None, str | None, float | None, int | None, bool, int], list[Instance]
        ] = {}  # cache of mesh files
        self._triangles = 0
        self._places = 0
        self.clips: list[Clip] = []  # clips of the mesh files

    def _has_animated_surface(self, material: str) -> bool:
        """Returns True if the emission or the anisotropy of a material may be animated. material: its name in the file."""
        path = ("materials", material)
        return self._moving.is_animated(path) or not self._moving.animated_fields(path).isdisjoint(("emission", "anisotropy"))

    def add(
        self,
        source: dict[str, Any],
        path: Path,
        parents: list[Place] | None = None,
        moves: bool = False,
        visible_to: list[str] | None = None,
    ) -> None:
        """Adds a shape of the scene file to the description, once for each of its own instances and each instance of its group.

        path: of the shape in the file. parents: names and world transforms of the group's instances; None at the top level.
        moves: whether the group is animated. visible_to: the kinds of rays that see the group's shapes; None: all.
        """
        visible_to = source.get("visible_to", visible_to)
        whole, fields = self._moving.is_animated(path), self._moving.animated_fields(path)
        moves = moves or whole or not fields.isdisjoint(("transform", "instances", "material", "center", "radius"))
        deforms = whole or not fields <= _PLACEMENT_FIELDS
        name = source.get("name", f"{source['type']} {path[-1]}")
        own = transforms.matrix(source.get("transform", []), self._document, (*path, "transform"))
        placed = [(name, own)]
        if "instances" in source:
            places = [transforms.matrix(t, self._document, (*path, "instances", i)) for i, t in enumerate(source["instances"])]
            placed = [(f"{name} [{i}]", transforms.joined(place, own, self._document, path)) for i, place in enumerate(places)]
        self._count(max(len(parents or ()), 1) * len(placed), path)
        if parents is not None:
            placed = [
                (f"{parent}/{called}", transforms.joined(outer, inner, self._document, path))
                for parent, outer in parents
                for called, inner in placed
            ]
        if source["type"] == "group":
            for i, child in enumerate(source["shapes"]):
                self.add(child, (*path, "shapes", i), placed, moves, visible_to)
            return
        first = len(self._description.instances), len(self._description.spheres)
        material = self._material_of(source, path)
        if source["type"] == "curves":
            self._mesh(self._curves(source, material, name, path), material, placed, path, moves, source.get("guide", False))
        elif source["type"] == "sphere" and self._displaces(material):
            x, y, z = source.get("center", (0, 0, 0))
            ball = [{"scale": source.get("radius", 1)}, {"translate": [x, y, z]}]
            inner = transforms.matrix(ball, self._document, path)
            balls = [(called, transforms.joined(place, inner, self._document, path)) for called, place in placed]
            self._mesh(shapes.globe(name), material, balls, path, moves, source.get("guide", False))
        elif source["type"] == "sphere":
            self._spheres(source, material, placed, path, moves)
        elif source["type"] == "mesh":
            self._mesh_file(source, material, placed, path, moves, deforms)
        else:
            mesh = self._make_mesh(source, name, path)
            mesh.deforms = deforms
            self._mesh(mesh, material, placed, path, moves, source.get("guide", False))
        if visible_to is not None:
            self._hide(visible_to, *first)

    def _displaces(self, material: int | None) -> bool:
        return material is not None and self._description.materials[material].displacement_texture is not None

    def _hide(self, visible_to: list[str], instance: int, sphere: int) -> None:
        """Makes shapes visible to some kinds of rays only. instance, sphere: the first instance and the first sphere of these."""
        instances, spheres = self._description.instances, self._description.spheres
        for i in range(instance, len(instances)):
            own = instances[i].material
            number = self._description.meshes[instances[i].mesh].material if own is None else own
            instances[i] = replace(instances[i], material=self._hidden(number, visible_to))
        for i in range(sphere, len(spheres)):
            spheres[i] = replace(spheres[i], material=self._hidden(spheres[i].material, visible_to))

    def _hidden(self, number: int, visible_to: list[str]) -> int:
        """Returns the index of a copy of a material that is visible to some kinds of rays only."""
        key = number, frozenset(visible_to)
        if key not in self._hidden_copies:
            materials = self._description.materials
            materials.append(with_visibility(materials[number], {kind: kind in visible_to for kind in RAY_KINDS}))
            self._hidden_copies[key] = len(materials) - 1
        return self._hidden_copies[key]

    def _count(self, places: int, path: Path) -> None:
        self._places += places
        if self._places > MAX_PLACES:
            raise self._document.error(
                path,
                Sentence(
                    "scene-shapes-too-many",
                    "with it the scene shows more than {most} shapes; use fewer instances",
                    most=MAX_PLACES,
                ),
            )

    def _make_mesh(self, source: dict[str, Any], name: str, path: Path) -> Mesh:
        if source["type"] == "faces":
            return self._faces(source, name, path)
        if source["type"] == "lathe":
            return shapes.lathe(name, [(r, y) for r, y in source["profile"]], source.get("segments", 96))
        if source["type"] == "disk":
            return shapes.disk(name, source.get("segments", 256))
        mesh = shapes.quad(name) if source["type"] == "quad" else shapes.cube(name)
        return subdivided(mesh, source.get("subdivision", 0))

    def _mesh(self, mesh: Mesh, material: int | None, placed: list[Place], path: Path, moves: bool, guide: bool) -> None:
        self._triangles += len(mesh.triangles)
        if self._triangles > MAX_TRIANGLES:
            raise self._document.error(
                path,
                Sentence(
                    "scene-triangles-too-many",
                    "with it the scene has more than {most} triangles; use fewer segments",
                    most=MAX_TRIANGLES,
                ),
            )
        mesh.material = self._plain_material() if material is None else material
        self._description.meshes.append(mesh)
        number = len(self._description.meshes) - 1
        moves = moves or mesh.material in self._restless
        self._description.instances += [Instance(number, place, name=name, moves=moves, guide=guide) for name, place in placed]

    def _faces(self, source: dict[str, Any], name: str, path: Path) -> Mesh:
        positions = in_exact_type(self._table(source["positions"], 3, (*path, "positions")))
        uvs = None
        if "uvs" in source:
            uvs = self._table(source["uvs"], 2, (*path, "uvs")).astype(np.float32)
            if len(uvs) != len(positions):
                raise self._document.error(
                    (*path, "uvs"),
                    Sentence(
                        "mesh-point-count-wrong",
                        "has {found} points for {positions} positions",
                        found=len(uvs),
                        positions=len(positions),
                    ),
                )
        triangles = []
        for i, polygon in enumerate(source["faces"]):
            here = (*path, "faces", i)
            if not isinstance(polygon, list) or len(polygon) < 3 or not all(type(corner) is int for corner in polygon):
                raise self._document.error(
                    here, Sentence("mesh-face-malformed", "is not a list of three or more indices of positions")
                )
            if not all(0 <= corner < len(positions) for corner in polygon):
                raise self._document.error(
                    here, Sentence("mesh-face-out-of-range", "has an index outside of 0 to {highest}", highest=len(positions) - 1)
                )
            triangles += [(polygon[0], b, c) for b, c in pairwise(polygon[1:])]
        mesh = Mesh(name, positions, np.array(triangles, np.int32).reshape(-1, 3), uvs=uvs)
        if levels := source.get("subdivision", 0):
            polygons = source["faces"]
            return subdivided(mesh, levels, Faces(np.array([len(each) for each in polygons]), np.concatenate(polygons)))
        return smoothed(mesh) if source.get("smooth", False) else mesh

    def _table(self, rows: list[Any], width: int, path: Path) -> npt.NDArray[np.float64]:
        """Returns an (N, width) array from a list of lists of numbers, such as vertex positions.

        They are checked here, not by the schema, which takes far longer per number. Raises SceneError for an invalid row.
        """
        for i, row in enumerate(rows):
            if not isinstance(row, list) or len(row) != width or not all(type(v) in (int, float) for v in row):
                raise self._document.error(
                    (*path, i), Sentence("number-list-malformed", "is not a list of {count} numbers", count=width)
                )
        with np.errstate(over="ignore"):
            found = np.array(rows, np.float64).reshape(-1, width)
            is_held = np.isfinite(found.astype(np.float32)).all(axis=1)
        if not is_held.all():
            raise self._document.error(
                (*path, int(np.argmin(is_held))), Sentence("number-overflow", "is too large for 32-bit numbers")
            )
        return found

    def _spheres(self, source: dict[str, Any], material: int | None, placed: list[Place], path: Path, moves: bool) -> None:
        for name, place in placed:
            scale = transforms.uniform_scale(place)
            if scale is None:
                raise self._document.error(
                    path,
                    Sentence(
                        "sphere-scaled-unevenly",
                        "a sphere needs a uniform scale; correct the transform",
                    ),
                )
            center = product(place, np.array([*source.get("center", (0, 0, 0)), 1.0])[:, None])[:, 0]
            number = self._plain_material() if material is None else material
            radius = float(source.get("radius", 1)) * scale
            self._description.spheres.append(Sphere(vec3(center[:3]), radius, number, name, source.get("guide", False), moves))

    def _curves(self, source: dict[str, Any], material: int | None, name: str, path: Path) -> Mesh:
        file = self._found(source, path)
        look = None if material is None else self._description.materials[material]
        hair = (look.kind == "hair", look.aspect_ratio) if look is not None else (False, 1.0)
        mesh = mesh_of_curves(source.get("basis", "bspline"), self._files.read(file), file, np.eye(4), *hair)
        mesh.name = name
        return mesh

    def _found(self, source: dict[str, Any], path: Path) -> str:
        """Returns the name among the files of a shape's file. Raises SceneError if it is missing."""
        name = self._files.find(source["file"], self._document.file)
        if name is None:
            raise self._document.error(
                (*path, "file"),
                Sentence("file-missing", "{name} is not among the files; add it", name=source["file"][:120]),
            )
        return name

    def _mesh_file(
        self, source: dict[str, Any], material: int | None, placed: list[Place], path: Path, moves: bool, deforms: bool
    ) -> None:
        name = self._found(source, path)
        if PurePosixPath(name).suffix.lower() not in {format.suffix for format in MESH_FORMATS}:
            others = [format.suffix for format in MESH_FORMATS]
            raise self._document.error(
                (*path, "file"),
                Sentence(
                    "mesh-format-unknown", "{name} is not a mesh file; give one of {formats}", name=name[:120], formats=others
                ),
            )
        variant, clip = (None if source.get(key) is None else str(source[key]) for key in ("variant", "clip"))
        thickness = source.get("thickness")
        wanted = (name, variant, clip, None if thickness is None else float(thickness))
        levels = source.get("subdivision", 0)
        key = (*wanted, material, deforms, levels)
        if key not in self._parts:
            part = self._files.get_or_make(("mesh file", *wanted), lambda: self._read_still_part(*wanted)) or self._read_part(
                *wanted
            )
            self._description.moves |= part.moves
            self.clips += part.clips if clip is None else [each for each in part.clips if each.name == clip]
            first = len(self._description.meshes)
            self._parts[key] = merge(part, self._description, material)
            for number in range(first, len(self._description.meshes)):
                mesh = self._description.meshes[number] = subdivided(self._description.meshes[number], levels)
                mesh.deforms |= deforms
        moves = moves or material in self._restless
        self._count(len(placed) * max(len(self._parts[key]) - 1, 0), path)  # the first instance at each place is already counted
        for called, place in placed:
            self._description.instances += [
                replace(
                    s,
                    transform=product(place, s.transform),
                    name=f"{called}/{s.name}" if s.name else called,
                    moves=s.moves or moves,
                    guide=source.get("guide", False),
                )
                for s in self._parts[key]
            ]

    def _read_part(self, name: str, variant: str | None, clip: str | None, thickness: float | None) -> SceneDescription:
        part = SceneDescription(name=name)
        read_file(self._files, name, part, variant, MESH_FORMATS, replace(self._moment, clip=clip), thickness)
        return part

    def _read_still_part(
        self, name: str, variant: str | None, clip: str | None, thickness: float | None
    ) -> SceneDescription | None:
        part = self._read_part(name, variant, clip, thickness)
        return None if part.moves else part

    def _material_of(self, source: dict[str, Any], path: Path) -> int | None:
        name = source.get("material")
        if name is None:
            return None
        if name not in self._materials:
            known = ", ".join(sorted(self._materials)[:10]) or "none"
            raise self._document.error(
                (*path, "material"),
                Sentence("material-name-unknown", "there is no material {name}; known are {known}", name=name[:80], known=known),
            )
        return self._materials[name]

    def _plain_material(self) -> int:
        if self._plain is None:
            self._description.materials.append(Material())
            self._plain = len(self._description.materials) - 1
        return self._plain
