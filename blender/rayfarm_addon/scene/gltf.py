"""Exports meshes, materials and transforms as a glTF file with separate array files, so that changes need small uploads only.

A mesh above LARGE has a separate file; smaller ones are distributed over a few shared files by their names.
"""

from __future__ import annotations

import hashlib
import json
from collections import defaultdict
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from .model import TO_Y_UP, Mesh, Node, Scene, TextureUse
from .placing import decompose, followed

__all__ = ["FILE", "gltf_files", "object_names"]

FILE = "geometry.gltf"
LARGE = 1 << 17
PACKS = 32
MIN_INSTANCES = 8  # instances of a mesh from which on their transforms are stored in an array
FLOAT, UINT = 5126, 5125
WRAPS = {"repeat": 10497, "clamp": 33071, "mirror": 33648}
INSTANCING = "EXT_mesh_gpu_instancing"
RAYS = "RAYFARM_node_rays"
MATTES = {"shadow_catcher": ("shadow_catcher", "reflection_catcher")}  # extras; Cycles' catchers show reflections, too


def gltf_files(scene: Scene) -> dict[str, bytes]:
    """Returns file name -> content of the glTF export, without its images."""
    return _Writer(scene).files()


def object_names(scene: Scene) -> list[Node]:
    """Returns the scene's nodes in the order in which the farm numbers its objects."""
    return [node for group in _groups(scene) for node in group]


def _groups(scene: Scene) -> list[list[Node]]:
    """Returns groups of nodes; each group is exported as one glTF node, with an instance for each member.

    Static nodes that are equal except for their transforms form a group if there are at least MIN_INSTANCES of them. Every other
    node is a group by itself.
    """
    alike: dict[Any, list[Node]] = defaultdict(list)
    for node in scene.nodes:
        if not node.places and not scene.meshes[node.mesh].shapes:
            alike[_appearance_key(node)].append(node)
    many = {key: nodes for key, nodes in alike.items() if len(nodes) >= MIN_INSTANCES}
    straight: dict[int, bool] = {}
    for nodes in many.values():
        whole = decompose(np.stack([node.place for node in nodes]))[3]
        straight.update((id(node), bool(good)) for node, good in zip(nodes, whole, strict=True))
    groups: list[list[Node]] = []
    first: dict[Any, list[Node]] = {}
    for node in scene.nodes:
        key = _appearance_key(node)
        if not straight.get(id(node), False):
            groups.append([node])
        elif key in first:
            first[key].append(node)
        else:
            first[key] = [node]
            groups.append(first[key])
    return groups


def _appearance_key(node: Node) -> Any:
    return node.mesh, node.materials, node.hidden_from, node.matte


class _Writer:
    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._buffers: dict[str, bytearray] = {}
        self._numbers: dict[str, int] = {}  # of buffers
        self._root: dict[str, Any] = {"asset": {"version": "2.0", "generator": "Rayfarm for Blender"}}
        for name in ("bufferViews", "accessors", "meshes", "nodes", "textures", "images", "samplers", "materials"):
            self._root[name] = []
        self._known: dict[Any, int] = {}
        self._samplers: list[dict[str, Any]] = []
        self._channels: list[dict[str, Any]] = []
        self._used: set[str] = set()
        self._times: int | None = None

    def files(self) -> dict[str, bytes]:
        root, scene = self._root, self._scene
        materials = list(scene.materials)
        numbers = {key: i for i, key in enumerate(materials)}
        root["materials"] = [
            {"name": scene.materials[key].name, **self._textured(scene.materials[key].gltf)} for key in materials
        ]
        top = root["nodes"]
        top.append({"name": "Blender", "matrix": TO_Y_UP.T.ravel().tolist(), "children": []})
        for group in _groups(scene):
            mesh = self._mesh(scene.meshes[group[0].mesh], group[0].materials, numbers)
            top[0]["children"].append(len(top))
            top.append(self._node(group, mesh, len(top)))
        root["scenes"], root["scene"] = [{"nodes": [0]}], 0
        if self._channels:
            root["animations"] = [{"name": "shutter", "samplers": self._samplers, "channels": self._channels}]
        root["buffers"] = [{"uri": name, "byteLength": len(self._buffers[name])} for name in self._numbers]
        if self._used:
            root["extensionsUsed"] = sorted(self._used)
        said = {key: value for key, value in root.items() if value != []}
        files = {name: bytes(buffer) for name, buffer in self._buffers.items()}
        return {FILE: json.dumps(said, separators=(",", ":")).encode(), **files}

    def _node(self, group: list[Node], mesh: int, number: int) -> dict[str, Any]:
        node = group[0]
        said: dict[str, Any] = {"name": node.name, "mesh": mesh}
        if node.hidden_from:
            self._used.add(RAYS)
            said["extensions"] = {RAYS: dict.fromkeys(node.hidden_from, False)}
        if node.matte:
            said["extras"] = dict.fromkeys(MATTES.get(node.matte, (node.matte,)), True)
        if len(group) > 1:
            self._used.add(INSTANCING)
            t, r, s, _ = decompose(np.stack([each.place for each in group]))
            key = "places of " + node.mesh
            at = {name: self._array(key, part) for name, part in (("TRANSLATION", t), ("ROTATION", r), ("SCALE", s))}
            said.setdefault("extensions", {})[INSTANCING] = {"attributes": at}
            return said
        shapes = self._scene.meshes[node.mesh].shapes
        if shapes:
            self._animate(number, "weights", _morph_weights(len(shapes)).ravel()[:, None])
        if node.places:
            t, r, s, straight = decompose(np.stack(node.places))
            if straight.all():
                for path, values in (("translation", t), ("rotation", followed(r)), ("scale", s)):
                    self._animate(number, path, values)
                middle = len(t) // 2
                return {**said, "translation": t[middle].tolist(), "rotation": r[middle].tolist(), "scale": s[middle].tolist()}
            self._scene.warn(f"{node.name}: is sheared while it moves, and shown without motion blur.")
        if not np.array_equal(node.place, np.eye(4)):
            said["matrix"] = node.place.T.ravel().tolist()
        return said

    def _animate(self, node: int, path: str, values: npt.NDArray[Any]) -> None:
        if self._times is None:
            self._times = self._array("times", np.array(self._scene.times)[:, None])
        self._channels.append({"sampler": len(self._samplers), "target": {"node": node, "path": path}})
        self._samplers.append({"input": self._times, "output": self._array(f"{path} of {node}", values)})

    def _mesh(self, mesh: Mesh, materials: tuple[str, ...], numbers: dict[str, int]) -> int:
        return self._get_or_create(
            ("mesh", mesh.key, materials), lambda: self._add("meshes", self._mesh_json(mesh, materials, numbers))
        )

    def _mesh_json(self, mesh: Mesh, materials: tuple[str, ...], numbers: dict[str, int]) -> dict[str, Any]:
        found = []
        attributes, targets = self._attributes(mesh)
        for slot, corners in mesh.parts:
            key = materials[min(slot, len(materials) - 1)] if materials else ""
            primitive: dict[str, Any] = {"attributes": attributes}
            primitive["indices"] = self._get_or_create(
                ("corners", mesh.key, slot), lambda corners=corners: self._array(mesh.key, corners, mesh)
            )
            if key in numbers:
                primitive["material"] = numbers[key]
            if targets:
                primitive["targets"] = targets
            found.append(primitive)
        said: dict[str, Any] = {"name": mesh.key[:100], "primitives": found}
        if targets:
            said["weights"] = [0.0] * len(targets)
        return said

    def _attributes(self, mesh: Mesh) -> tuple[dict[str, int], list[dict[str, int]]]:
        arrays: dict[str, npt.NDArray[Any] | None] = {"POSITION": mesh.positions, "NORMAL": mesh.normals, "COLOR_0": mesh.colors}
        arrays["_FIBRE"] = mesh.fibres
        arrays.update((f"TEXCOORD_{i}", uv) for i, uv in enumerate(mesh.uvs[:2]))
        found = {
            name: self._get_or_create((name, mesh.key), lambda array=array: self._array(mesh.key, array, mesh))
            for name, array in arrays.items()
            if array is not None
        }
        targets = []
        for i, (positions, normals) in enumerate(mesh.shapes):
            if i == len(mesh.shapes) // 2:
                continue
            more: dict[str, npt.NDArray[Any]] = {"POSITION": positions - mesh.positions}
            if normals is not None and mesh.normals is not None:
                more["NORMAL"] = normals - mesh.normals
            targets.append(
                {
                    name: self._get_or_create((name, i, mesh.key), lambda array=array: self._array(mesh.key, array, mesh))
                    for name, array in more.items()
                }
            )
        return found, targets

    def _textured(self, data: Any) -> Any:
        """Returns a material's JSON with each TextureUse replaced by a glTF texture reference."""
        if isinstance(data, TextureUse):
            return self._texture(data)
        if isinstance(data, list):
            return [self._textured(each) for each in data]
        if not isinstance(data, dict):
            return data
        self._used |= set(data.get("extensions", ()))
        return {key: self._textured(value) for key, value in data.items()}

    def _texture(self, use: TextureUse) -> dict[str, Any]:
        image = self._get_or_create(("image", use.image), lambda: self._add("images", {"uri": use.image}))
        filter = 9728 if use.nearest else 9729
        sampler = {"wrapS": WRAPS[use.wrap[0]], "wrapT": WRAPS[use.wrap[1]], "magFilter": filter}
        lies = self._get_or_create(("sampler", *sampler.values()), lambda: self._add("samplers", sampler))
        number = self._get_or_create(("texture", image, lies), lambda: self._add("textures", {"source": image, "sampler": lies}))
        said: dict[str, Any] = {"index": number}
        if use.uv_set:
            said["texCoord"] = use.uv_set
        if use.strength is not None:
            said["scale"] = use.strength
        if (use.offset, use.rotation, use.scale) != ((0.0, 0.0), 0.0, (1.0, 1.0)):
            self._used.add("KHR_texture_transform")
            lies_as = {"offset": list(use.offset), "rotation": use.rotation, "scale": list(use.scale)}
            said["extensions"] = {"KHR_texture_transform": lies_as}
        return said

    def _get_or_create(self, key: Any, make: Callable[[], int]) -> int:
        if key not in self._known:
            self._known[key] = make()
        return self._known[key]

    def _add(self, name: str, data: dict[str, Any]) -> int:
        self._root[name].append(data)
        return len(self._root[name]) - 1

    def _array(self, key: str, array: npt.NDArray[Any], mesh: Mesh | None = None) -> int:
        """Appends an array to the buffer file of `key`; returns the number of its accessor."""
        is_index = array.dtype == np.uint32
        values = np.ascontiguousarray(array, np.uint32 if is_index else np.float32)
        width = values.shape[1] if values.ndim > 1 else 1
        name = _file_of(key, mesh)
        if name not in self._numbers:
            self._numbers[name] = len(self._numbers)
            self._buffers[name] = bytearray()
        buffer = self._buffers[name]
        view = {"buffer": self._numbers[name], "byteOffset": len(buffer), "byteLength": values.nbytes}
        buffer += values.data.cast("B") if values.nbytes else b""
        said: dict[str, Any] = {"bufferView": self._add("bufferViews", view), "count": len(values)}
        said |= {"componentType": UINT if is_index else FLOAT, "type": ("SCALAR", "VEC2", "VEC3", "VEC4")[width - 1]}
        return self._add("accessors", said)


def _morph_weights(count: int) -> npt.NDArray[np.float64]:
    """Returns the morph target weights at each key, (keys, keys - 1).

    Each key but the middle one has a target, with weight 1 at that key and 0 at all others; the middle key is the mesh itself.
    """
    return np.delete(np.eye(count), count // 2, axis=1)


def _file_of(key: str, mesh: Mesh | None) -> str:
    name = hashlib.sha256(key.encode()).hexdigest()
    if mesh is not None:
        size = mesh.positions.nbytes * (2 + 2 * len(mesh.shapes)) + sum(corners.nbytes for _, corners in mesh.parts)
        if size > LARGE:
            return f"meshes/{name[:16]}.bin"
    elif not key.startswith("places"):
        return "moves.bin"
    return f"meshes/pack-{int(name[:8], 16) % PACKS:02}.bin"
