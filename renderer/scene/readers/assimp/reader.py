"""Reads a file that assimp supports, at a moment."""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Callable
from pathlib import PurePosixPath

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError, SettingsError
from renderer.scene import description as scene_description
from renderer.scene.animation import DEFAULT_FPS, Moment
from renderer.scene.description import Instance, Light, Mesh, SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.kernel_arguments import read_only
from renderer.scene.normals import smoothed_together
from renderer.scene.readers.assimp.animation import Movement
from renderer.scene.readers.assimp.far import import_exactly
from renderer.scene.readers.assimp.library import Camera, Imported, Lamp, Shape
from renderer.scene.readers.assimp.materials import Materials
from renderer.scene.readers.assimp.untrusted import refuse_expanding_files
from renderer.scene.readers.number_ranges import clamped
from renderer.scene.readers.skinning import carried
from renderer.scene.text_encoding import as_utf8
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence, count_of, with_count
from renderer.settings import View

__all__ = ["read"]

F64 = npt.NDArray[np.float64]

_DIRECTIONAL, _POINT, _SPOT, _AMBIENT = 1, 2, 3, 4
_ASPECT = 16 / 9  # of cameras without an aspect ratio
_MOST = 1e12
_TEXT = (".ac", ".ac3d", ".ase", ".dxf", ".md5mesh", ".nff", ".ogex", ".smd", ".x")  # text formats whose importers require UTF-8


def read(
    files: SceneFiles,
    main: str,
    description: SceneDescription,
    moment: Moment = Moment(),
    scale: float = 1.0,
    change: Callable[[bytes], bytes] = bytes,
) -> None:
    """Adds the file's scene at a moment to the description. Raises SceneError if the file cannot be imported.

    scale: factor of all lengths; change: preprocesses the file's bytes.
    """
    imported = files.get_or_make(("assimp", main), lambda: _import_file(files, main, scale, change))
    shelf = TextureShelf(description, files)
    movement = Movement(imported, moment, DEFAULT_FPS, main)
    description.clips = movement.clips
    description.moves |= len(movement.moving) > 0
    _Reader(files, main, description, imported, movement, shelf).read()


def _import_file(files: SceneFiles, main: str, scale: float, change: Callable[[bytes], bytes]) -> Imported:
    data = files.read(main)
    if main.lower().endswith(_TEXT):
        data = as_utf8(data)
    refuse_expanding_files(data, main)
    data = change(data)
    imported = import_exactly(data, main)
    if imported.nodes:
        imported.nodes[0].local = np.diag([scale, scale, scale, 1.0]) @ imported.nodes[0].local
    return imported


class _Reader:
    """Adds the contents of an imported file to a description."""

    def __init__(
        self,
        files: SceneFiles,
        main: str,
        description: SceneDescription,
        imported: Imported,
        movement: Movement,
        shelf: TextureShelf,
    ) -> None:
        self._files, self._main, self._description, self._imported = files, main, description, imported
        self._movement, self._shelf = movement, shelf
        self._materials = Materials(imported, main, files, shelf, description.materials)
        self._by_name = {node.name: i for i, node in reversed(list(enumerate(imported.nodes)))}
        self._numbers: dict[int, int] = {}
        self._names: Counter[str] = Counter()
        self._odd: Counter[str] = Counter()

    def read(self) -> None:
        """Adds all meshes, lights and cameras to the description."""
        first = len(self._description.instances)
        for i, node in enumerate(self._imported.nodes):
            shapes = [number for number in node.meshes if number in self._imported.meshes]
            name = self._unique(node.name or self._imported.meshes[shapes[0]].name or "mesh") if shapes else ""
            self._add_meshes([number for number in shapes if not self._imported.meshes[number].bones])
            for number in shapes:
                self._add_instance(number, i, name)
        middle = self._bounds_centre(first)
        for lamp in self._imported.lamps:
            self._light(lamp, middle)
        for camera in self._imported.cameras:
            self._camera(camera)
        if self._main.lower().endswith((".x3d", ".wrl")):
            self._odd[Sentence("assimp-viewpoints", "viewpoints, which are X3D's cameras")] += self._files.read(self._main).count(
                b"Viewpoint "
            )
        self._odd[Sentence("assimp-line-point-meshes", "meshes of lines and points")] += self._imported.loose
        self._odd[Sentence("unit-concave-polygons", "concave polygons, filled as if convex")] += sum(
            m.unfilled for m in self._imported.meshes.values()
        )
        self._odd[
            Sentence("assimp-coordinate-colour-sets", "sets of texture coordinates or vertex colours beyond the first")
        ] += sum(m.more_sets for m in self._imported.meshes.values())
        self._odd[Sentence("assimp-textures-stacked", "textures blended over another texture of the same material input")] += (
            self._imported.stacked
        )
        self._odd[Sentence("assimp-later-frames", "frames, of which only the first is shown")] += _frames(self._main, self._files)
        self._odd[Sentence("assimp-parts-unfinished", "parts that the importer could not finish")] += not self._imported.is_whole
        self._odd += self._materials.odd
        self._odd[Sentence("assimp-morph-targets", "morph targets")] += self._imported.morphs
        self._odd[Sentence("assimp-mesh-animation", "animation channels of mesh shapes")] += self._movement.others
        listed = [count_of(count, words) for words, count in self._odd.items() if count]
        if listed:
            self._shelf.warn(
                Sentence(
                    "file-features-not-read", "{file}: not supported and left out: {features}.", file=self._main, features=listed
                )
            )
        for text, count in self._imported.said.items():
            self._shelf.warn(
                Sentence(
                    "importer-message",
                    "{file}: importer message: {text}.",
                    file=self._main,
                    text=with_count(text, count),
                )
            )

    def _add_instance(self, number: int, node: int, name: str) -> None:
        shape = self._imported.meshes[number]
        world = self._world_transform(node)
        moves = node in self._movement.moving
        if shape.bones:
            mesh = self._skinned(shape, world)
            mesh.deforms = moves or any(self._by_name.get(b.node, -1) in self._movement.moving for b in shape.bones)
            self._description.meshes.append(mesh)
            known, world = len(self._description.meshes) - 1, np.eye(4)
            moves = mesh.deforms
        else:
            known = self._numbers[number]
        self._description.instances.append(Instance(known, world, name=name, moves=moves))

    def _add_meshes(self, numbers: list[int]) -> None:
        """Adds the meshes of a node, which are the parts of one surface with different materials."""
        new = [number for number in numbers if number not in self._numbers]
        if not new:
            return
        shapes = [self._imported.meshes[number] for number in new]
        found = self._files.get_or_make(("assimp meshes", self._main, tuple(new)), functools.partial(_meshes, shapes))
        for number, shape, mesh in zip(new, shapes, found, strict=True):
            made = Mesh(**{**vars(mesh), "material": self._materials.number(shape.material)})
            self._description.meshes.append(made)
            self._numbers[number] = len(self._description.meshes) - 1

    def _skinned(self, shape: Shape, world: F64) -> Mesh:
        """Returns a mesh in world space, deformed by its bones; vertices without bones follow the node."""
        count = len(shape.positions)
        places = [world]
        vertex, joint, weight = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [np.zeros(0, np.float32)]
        for bone in shape.bones:
            at = self._by_name.get(bone.node)
            if at is None:
                self._odd[Sentence("assimp-bones-without-node", "bones without a node")] += 1
                continue
            places.append(self._world_transform(at) @ bone.offset)
            vertex.append(bone.vertices.astype(np.int64))
            joint.append(np.full(len(bone.vertices), len(places) - 1))
            weight.append(bone.weights)
        vertices, joints, weights = np.concatenate(vertex), np.concatenate(joint), np.concatenate(weight)
        order = np.argsort(vertices, kind="stable")
        held = np.bincount(vertices, minlength=count)
        rank = np.arange(len(order)) - np.repeat(np.cumsum(held) - held, held)
        width = int(held.max(initial=0)) + 1
        table, share = np.zeros((count, width), np.int64), np.zeros((count, width), np.float32)
        table[vertices[order], rank], share[vertices[order], rank] = joints[order], weights[order]
        share[share.sum(axis=1) <= 0, -1] = 1.0
        none = np.zeros((0, 3), np.float32)
        normals = none if shape.normals is None else shape.normals
        turned = np.empty(normals.shape, np.float32)
        arrays = (np.stack(places), table, share, shape.positions, normals, none)
        placed = carried(*(read_only(np.ascontiguousarray(a)) for a in arrays), turned=turned, bent=none.copy())
        mesh = _as_mesh(shape)
        mesh.positions, mesh.normals = placed, None if shape.normals is None else turned
        mesh.material = self._materials.number(shape.material)
        return mesh

    def _world_transform(self, node: int) -> F64:
        found = self._movement.worlds[node]
        if not np.isfinite(found).all():
            name = self._imported.nodes[node].name[:80]
            raise SceneError(
                Sentence(
                    "node-transform-not-finite",
                    "{file}: {name} has a transform that is not finite; export the file again",
                    file=self._main,
                    name=name,
                )
            )
        return found

    def _bounds_centre(self, first: int) -> F64:
        """Returns the centre of the bounding box of the description's instances from index `first` on."""
        corners = []
        for instance in self._description.instances[first:]:
            points = self._description.meshes[instance.mesh].positions
            box = np.stack([points.min(axis=0), points.max(axis=0)]).astype(np.float64)
            corners.append(box @ instance.transform[:3, :3].T + instance.transform[:3, 3])
        every = np.concatenate(corners) if corners else np.zeros((1, 3))
        return np.nan_to_num((every.min(axis=0) + every.max(axis=0)) / 2)

    def _light(self, lamp: Lamp, middle: F64) -> None:
        if lamp.kind not in (_DIRECTIONAL, _POINT, _SPOT):
            is_ambient = lamp.kind == _AMBIENT
            kind = Sentence("lights-ambient", "ambient lights") if is_ambient else Sentence("lights-area", "area lights")
            self._odd[kind] += 1
            return
        at = self._by_name.get(lamp.node)
        world = np.eye(4) if at is None else self._world_transform(at)
        position, direction = world[:3, :3] @ lamp.position + world[:3, 3], world[:3, :3] @ lamp.direction
        length = float(np.linalg.norm(direction))
        direction = direction / length if length > 0 else np.array([0.0, -1.0, 0.0])
        name = self._unique(lamp.node or "light")
        # A white surface that faces the light has the light's colour: with inverse-square falloff
        # at distance 1, without falloff at the centre of the scene.
        scale = math.pi
        if lamp.kind != _DIRECTIONAL:
            far = float(np.linalg.norm(position - middle))
            if lamp.quadratic <= 1e-9 or lamp.linear > 1e-9:
                self._odd[Sentence("assimp-light-falloff", "light falloffs other than inverse square")] += 1
            scale *= 1 / lamp.quadratic if lamp.quadratic > 1e-9 else max(far, 1e-3) ** 2
        r, g, b = (clamped(float(np.nan_to_num(c)) * scale, 0.0, _MOST) for c in lamp.color)
        x, y, z = (float(c) for c in np.nan_to_num(position))
        u, v, w = (float(c) for c in direction)
        if lamp.kind == _DIRECTIONAL:
            light = Light("directional", (r, g, b), (x, y, z), (u, v, w), name=name)
        elif lamp.kind == _POINT:
            light = Light("point", (r, g, b), (x, y, z), (u, v, w), name=name)
        else:
            outer = clamped(math.degrees(lamp.outer) / 2 if 0 < lamp.outer < 2 * math.pi else 45.0, 0.01, 90.0)
            inner = clamped(math.degrees(lamp.inner) / 2 if 0 < lamp.inner < 2 * math.pi else 0.0, 0.0, outer)
            light = Light("spot", (r, g, b), (x, y, z), (u, v, w), inner_cone=inner, outer_cone=outer, name=name)
        self._description.lights.append(light)

    def _camera(self, camera: Camera) -> None:
        at = self._by_name.get(camera.node)
        world = np.eye(4) if at is None else self._world_transform(at)
        eye = world[:3, :3] @ camera.position + world[:3, 3]
        forward, up = world[:3, :3] @ camera.towards, world[:3, :3] @ camera.up
        name = self._unique(camera.node or "camera")
        aspect = camera.aspect if math.isfinite(camera.aspect) and camera.aspect > 0 else _ASPECT
        length = float(np.linalg.norm(forward))
        target = eye + forward / length * max(1.0, float(np.abs(eye).max())) if length > 0 else eye
        a, b, c = ((float(p[0]), float(p[1]), float(p[2])) for p in (eye, target, up))
        try:
            if camera.width > 0:
                view = View(a, b, c, projection="orthographic", height=2 * camera.width / aspect)
            else:
                tangent = math.tan(clamped(camera.fov, 1e-3, 3.0) / 2) / aspect
                view = View(a, b, c, math.degrees(2 * math.atan(tangent)))
        except SettingsError as error:
            self._shelf.warn(Sentence("camera-left-out", "Camera {name}: {error}; it is left out.", name=name, error=error))
            return
        self._description.cameras.append(scene_description.Camera(name, view))

    def _unique(self, name: str) -> str:
        self._names[name] += 1
        return name if self._names[name] == 1 else f"{name} ({self._names[name]})"


def _frames(main: str, files: SceneFiles) -> int:
    """Returns the number of animation frames in a file (.md2, .iqm), or of animation files beside it (.md5mesh).

    Assimp does not read these animations.
    """
    suffix = PurePosixPath(main).suffix.lower()
    if suffix == ".md5mesh":
        return len(files.siblings(main, (".md5anim",)))
    data, at, least = files.read(main), *{".md2": (40, 1), ".iqm": (84, 0)}.get(suffix, (0, 0))
    count = int.from_bytes(data[at : at + 4], "little") if at else 0
    return count if count > least else 0


def _as_mesh(shape: Shape) -> Mesh:
    uvs = [np.column_stack([u[:, 0], 1 - u[:, 1]]).astype(np.float32) for u in shape.uvs]  # v upwards to v downwards
    colors = shape.colors
    if colors is not None and (colors == 1).all():
        colors = None
    first, second = [*uvs, None, None][:2]
    return Mesh(shape.name, shape.positions, shape.triangles, shape.normals, first, 0, second, colors)


def _meshes(shapes: list[Shape]) -> list[Mesh]:
    return smoothed_together([_as_mesh(shape) for shape in shapes], surfaces=[0] * len(shapes))
