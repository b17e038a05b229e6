"""A glTF file as a scene: its hierarchy of nodes, and what hangs on them."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError, SettingsError
from renderer.scene.description import Camera, Instance, Material, SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.readers.gltf import draco
from renderer.scene.readers.gltf.accessors import Accessors
from renderer.scene.readers.gltf.container import Json, parse
from renderer.scene.readers.gltf.materials import Materials, UvUse
from renderer.scene.readers.gltf.primitives import read_primitive
from renderer.scene.textures import TextureShelf
from renderer.settings import View

__all__ = ["read"]

Matrix = npt.NDArray[np.float64]

MAX_NODES = 200_000
MAX_DEPTH = 1000

# Rendered, or warned of where they are used.
_KNOWN = {
    "EXT_texture_webp",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_transmission",
    "KHR_mesh_quantization",
    "KHR_texture_transform",
    draco.EXTENSION,
}


def read(files: SceneFiles, main: str, description: SceneDescription) -> None:
    """Adds the file's default scene to the description. Raises SceneError."""
    root, binary = parse(files.read(main), main)
    shelf = TextureShelf(description, files)
    _check_extensions(root, shelf)
    accessors = Accessors(root, binary, files)
    materials = Materials(root, accessors, files, shelf)
    description.materials += materials.read()
    meshes = _Meshes(root, accessors, materials, shelf, description)
    _Nodes(root, meshes, shelf, description).walk()
    for i, animation in enumerate(root.objects("animations")):
        description.animations.append(animation.text("name", "") or f"animation {i}")
    if description.animations:
        shelf.warn("Animations are named but not evaluated yet; the file's rest pose is rendered.")


def _check_extensions(root: Json, shelf: TextureShelf) -> None:
    for key in ("extensionsRequired", "extensionsUsed"):
        names = root.value.get(key, [])
        if not isinstance(names, list) or not all(isinstance(n, str) for n in names):
            raise root.wrong(key, "is not a list of names")
        unknown = [n[:60] for n in names if n not in _KNOWN]
        if unknown and key == "extensionsRequired":
            raise SceneError(f"{root.file}: needs {', '.join(unknown[:8])}, which is not supported; export it without")
        if unknown:
            shelf.warn(f"Not supported and left out: {', '.join(unknown[:20])}.")


class _Meshes:
    """Meshes of the description by glTF mesh, read when a node first shows them."""

    def __init__(
        self, root: Json, accessors: Accessors, materials: Materials, shelf: TextureShelf, description: SceneDescription
    ) -> None:
        self.sources = root.objects("meshes")
        self._accessors, self._materials, self._shelf, self._description = accessors, materials, shelf, description
        self._read: dict[int, list[int]] = {}
        self._default: int | None = None

    def of(self, index: int) -> list[int]:
        if index not in self._read:
            source = self.sources[index]
            name = source.text("name", "") or f"mesh {index}"
            self._read[index] = []
            for primitive in source.objects("primitives"):
                material = primitive.index("material", self._materials.uv_uses)
                use = UvUse() if material is None else self._materials.uv_uses[material]
                mesh = read_primitive(primitive, name, use, self._accessors, self._shelf)
                if mesh is not None:
                    mesh.material = self._default_material() if material is None else material
                    self._description.meshes.append(mesh)
                    self._read[index].append(len(self._description.meshes) - 1)
        return self._read[index]

    def _default_material(self) -> int:
        if self._default is None:  # specification 3.7.2.1: the default of every property, metallic 1 among them
            material = Material("glTF default", "metallic_roughness", (1.0, 1.0, 1.0), metallic=1.0, roughness=1.0)
            self._description.materials.append(material)
            self._default = len(self._description.materials) - 1
        return self._default


class _Nodes:
    """Walks the default scene's nodes and places their meshes and cameras in the world."""

    def __init__(self, root: Json, meshes: _Meshes, shelf: TextureShelf, description: SceneDescription) -> None:
        self._root, self._meshes, self._shelf, self._description = root, meshes, shelf, description
        self._nodes = root.objects("nodes")
        self._cameras = root.objects("cameras")

    def walk(self) -> None:
        if len(self._nodes) > MAX_NODES:
            raise SceneError(f"{self._root.file}: has {len(self._nodes)} nodes; at most {MAX_NODES} fit")
        seen: set[int] = set()
        stack = [(i, np.eye(4), 0) for i in reversed(self._top())]
        while stack:
            index, parent, depth = stack.pop()
            node = self._nodes[index]
            if index in seen or depth > MAX_DEPTH:
                raise SceneError(
                    f"{self._root.file}: {node.where} hangs below two parents or below itself; export the file again"
                )
            seen.add(index)
            world = parent @ _local(node)
            self._place(node, index, world)
            stack += [(child, world, depth + 1) for child in reversed(node.indices("children", self._nodes))]

    def _top(self) -> list[int]:
        scenes = self._root.objects("scenes")
        if scenes:
            scene = scenes[self._root.integer("scene", 0, high=len(scenes))]
            self._description.name = scene.text("name", "") or self._description.name
            return scene.indices("nodes", self._nodes)
        children = {c for n in self._nodes for c in n.indices("children", self._nodes)}
        return [i for i in range(len(self._nodes)) if i not in children]

    def _place(self, node: Json, index: int, world: Matrix) -> None:
        if not np.isfinite(world).all():
            raise SceneError(f"{self._root.file}: {node.where} has a transform that is not finite; export the file again")
        mesh = node.index("mesh", self._meshes.sources)
        if mesh is not None:
            if "skin" in node:
                self._shelf.warn(f"Node {node.text('name', '') or index}: its skin is not applied; it stands in its rest pose.")
            self._description.instances += [Instance(m, world) for m in self._meshes.of(mesh)]
        camera = node.index("camera", self._cameras)
        if camera is not None:
            self._add_camera(self._cameras[camera], node, camera, world)

    def _add_camera(self, camera: Json, node: Json, index: int, world: Matrix) -> None:
        name = node.text("name", "") or camera.text("name", "") or f"camera {index}"
        perspective = camera.object("perspective")
        if perspective is None:
            self._shelf.warn(f"Camera {name}: only perspective cameras are rendered; it is left out.")
            return
        fov = math.degrees(perspective.number("yfov", math.radians(40)))
        eye, forward, up = world[:3, 3], _unit(-world[:3, 2]), _unit(world[:3, 1])
        try:
            view = View(_vec3(eye), _vec3(eye + forward * max(1.0, float(np.abs(eye).max()))), _vec3(up), fov)
        except SettingsError as error:
            self._shelf.warn(f"Camera {name}: {error}; it is left out.")
            return
        taken = {c.name for c in self._description.cameras}
        self._description.cameras.append(Camera(name if name not in taken else f"{name} ({len(taken) + 1})", view))


def _local(node: Json) -> Matrix:
    if "matrix" in node:
        return np.array(node.vector("matrix", (0.0,) * 16)).reshape(4, 4).T  # column-major
    matrix = np.eye(4)
    matrix[:3, :3] = _rotation(node.vector("rotation", (0.0, 0.0, 0.0, 1.0))) * np.array(node.vector("scale", (1.0, 1.0, 1.0)))
    matrix[:3, 3] = node.vector("translation", (0.0, 0.0, 0.0))
    return matrix


def _rotation(quaternion: tuple[float, ...]) -> Matrix:
    length = math.sqrt(sum(c * c for c in quaternion))
    if length < 1e-12:
        return np.eye(3)
    x, y, z, w = (c / length for c in quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _unit(v: Matrix) -> Matrix:
    return v / max(float(np.linalg.norm(v)), 1e-30)


def _vec3(v: Matrix) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])
