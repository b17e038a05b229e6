"""A glTF file as a scene: its hierarchy of nodes, and what hangs on them."""

from __future__ import annotations

import numpy as np

from renderer.errors import SceneError, SettingsError
from renderer.scene.animation import Moment
from renderer.scene.description import Camera, Instance, SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.matrices import product
from renderer.scene.readers.gltf import animation, draco, instancing, lights, materials, textures, variants
from renderer.scene.readers.gltf.accessors import Accessors
from renderer.scene.readers.gltf.cameras import read_camera
from renderer.scene.readers.gltf.container import Json, parse
from renderer.scene.readers.gltf.deform import bind_matrices
from renderer.scene.readers.gltf.meshes import Meshes
from renderer.scene.readers.gltf.moving import Moving
from renderer.scene.readers.gltf.transforms import Matrix, local
from renderer.scene.textures import TextureShelf

__all__ = ["read"]

MAX_NODES = 200_000
MAX_INSTANCES = 500_000

_VISIBILITY = "KHR_node_visibility"

_READ = {
    animation.EXTENSION,
    draco.EXTENSION,
    instancing.EXTENSION,
    lights.EXTENSION,
    _VISIBILITY,
    variants.EXTENSION,
    "KHR_mesh_quantization",
    *materials.EXTENSIONS,
    *textures.EXTENSIONS,
}
_WITHOUT_EFFECT = {"KHR_xmp_json_ld"}  # notes


def read(
    files: SceneFiles, main: str, description: SceneDescription, variant: str | None = None, moment: Moment = Moment()
) -> None:
    """Adds the file's default scene at a moment to the description, with its own materials or those of a variant.

    Raises SceneError.
    """
    root, binary = files.recall(("glTF", main), lambda: parse(files.read(main), main))
    shelf = TextureShelf(description, files)
    _check_extensions(root, shelf)
    accessors = Accessors(root, binary, files)
    moving = animation.Animations(root, accessors, files)
    description.clips = moving.clips
    description.moves |= len(moving.clips) > 0
    root = moving.at(moment)
    for sentence in moving.warnings:
        shelf.warn(sentence)
    surfaces = materials.Materials(root, textures.Textures(root, accessors, files, shelf), shelf, description.materials)
    chosen = variants.Variants(root, variant)
    description.variants = chosen.names
    restless = Moving(root, moving.moving)
    meshes = Meshes(root, accessors, files, surfaces, chosen, shelf, description.meshes, restless)
    _Nodes(root, accessors, meshes, shelf, description, restless).walk()


def _check_extensions(root: Json, shelf: TextureShelf) -> None:
    for key in ("extensionsRequired", "extensionsUsed"):
        names = root.value.get(key, [])
        if not isinstance(names, list) or not all(isinstance(n, str) for n in names):
            raise root.wrong(key, "is not a list of names")
        unknown = [n[:60] for n in names if n not in _READ and n not in _WITHOUT_EFFECT]
        if any("meshopt" in n for n in unknown):
            raise SceneError(f"{root.file}: is packed by meshopt, which is not read here; export it without, or with Draco")
        if unknown and key == "extensionsRequired":
            raise SceneError(f"{root.file}: needs {', '.join(unknown[:8])}, which is not supported; export it without")
        if unknown:
            shelf.warn(f"Not supported and left out: {', '.join(unknown[:20])}.")


class _Nodes:
    """Walks the default scene's nodes and places their meshes, lights and cameras in the world."""

    def __init__(
        self,
        root: Json,
        accessors: Accessors,
        meshes: Meshes,
        shelf: TextureShelf,
        description: SceneDescription,
        moving: Moving,
    ) -> None:
        self._root, self._accessors, self._meshes, self._moving = root, accessors, meshes, moving
        self._shelf, self._description = shelf, description
        self._nodes = root.objects("nodes")
        self._cameras = root.objects("cameras")
        punctual = root.extension(lights.EXTENSION)
        self._lights = punctual.objects("lights") if punctual else []
        self._skins = root.objects("skins")
        self._names: dict[str, int] = {}
        self._worlds: dict[int, Matrix] = {}  # of the scene's nodes

    def walk(self) -> None:
        if len(self._nodes) > MAX_NODES:
            raise SceneError(f"{self._root.file}: has {len(self._nodes)} nodes; at most {MAX_NODES} fit")
        parents, shown_nodes = self._tree()
        self._moving.inherit(parents)
        self._worlds = self._in_world(parents)
        for index in parents:
            self._add_camera(self._nodes[index], self._worlds[index])
        for index in shown_nodes:  # when all joints are in their places
            self._place(self._nodes[index], self._worlds[index], index in self._moving.nodes)

    def _in_world(self, parents: dict[int, int | None]) -> dict[int, Matrix]:
        """Where the scene's nodes are. All of one depth at once: files have ten thousands of small nodes."""
        own = dict(zip(parents, local([self._nodes[index] for index in parents]), strict=True))
        below = {index: parent for index, parent in parents.items() if parent is not None}
        depth: dict[int, int] = {}
        levels: list[list[int]] = []
        for index in parents:
            depth[index] = depth[below[index]] + 1 if index in below else 0
            if depth[index] == len(levels):
                levels.append([])
            levels[depth[index]].append(index)
        worlds: dict[int, Matrix] = {}
        for level in levels:
            places = np.stack([own[index] for index in level])
            if depth[level[0]]:
                with np.errstate(over="ignore", invalid="ignore"):
                    places = product(np.stack([worlds[below[index]] for index in level]), places)
            bad = ~np.isfinite(places).all(axis=(1, 2))
            if bad.any():
                where = self._nodes[level[int(np.argmax(bad))]].where
                raise SceneError(f"{self._root.file}: {where} has a transform that is not finite; export the file again")
            worlds.update(zip(level, places, strict=True))
        return worlds

    def _tree(self) -> tuple[dict[int, int | None], list[int]]:
        """The scene's nodes with their parents, each after its parent; and those of them that are shown."""
        parents: dict[int, int | None] = {}
        shown_nodes: list[int] = []
        stack: list[tuple[int, int | None, bool]] = [(i, None, True) for i in reversed(self._top())]
        while stack:
            index, parent, shown = stack.pop()
            node = self._nodes[index]
            if index in parents:
                raise SceneError(
                    f"{self._root.file}: {node.where} hangs below two parents or below itself; export the file again"
                )
            parents[index] = parent
            visibility = node.extension(_VISIBILITY)
            shown = shown and (visibility is None or visibility.value.get("visible") is not False)
            shown_nodes += [index] if shown else []
            stack += [(child, index, shown) for child in reversed(node.indices("children", self._nodes))]
        return parents, shown_nodes

    def _top(self) -> list[int]:
        scenes = self._root.objects("scenes")
        if scenes:
            scene = scenes[self._root.integer("scene", 0, high=len(scenes))]
            self._description.name = scene.text("name", "") or self._description.name
            return scene.indices("nodes", self._nodes)
        children = {c for n in self._nodes for c in n.indices("children", self._nodes)}
        return [i for i in range(len(self._nodes)) if i not in children]

    def _place(self, node: Json, world: Matrix, moves: bool) -> None:
        mesh = node.index("mesh", self._meshes.sources)
        if mesh is not None:
            name = self._unique(node.text("name", "") or self._meshes.name(mesh))
            copies = node.extension(instancing.EXTENSION)
            skin = node.index("skin", self._skins)
            if copies:
                left = MAX_INSTANCES - len(self._description.instances)
                places = product(world, instancing.instance_transforms(copies, self._accessors, left))
                for i, place in enumerate(places):
                    self._show(self._meshes.of(mesh, node), place, f"{name} [{i}]", moves)
            elif skin is not None:
                joints = self._skins[skin].indices("joints", self._nodes)
                bent = not self._moving.nodes.isdisjoint(joints)
                found = self._meshes.skinned(mesh, node, self._joints(self._skins[skin], joints), bent)
                self._show(found, np.eye(4), name, self._moving.appears(node))
            else:
                self._show(self._meshes.of(mesh, node), world, name, moves)
        light = node.extension(lights.EXTENSION)
        if light:
            source = self._lights[light.integer("light", high=len(self._lights))]
            name = node.text("name", "") or source.text("name", "") or f"light {len(self._description.lights)}"
            self._description.lights.append(lights.read_light(source, name, world))

    def _show(self, meshes: list[int], place: Matrix, name: str, moves: bool) -> None:
        restless = self._meshes.restless
        self._description.instances += [Instance(m, place, name=name, moves=moves or m in restless) for m in meshes]

    def _joints(self, skin: Json, joints: list[int]) -> Matrix:
        """(J, 4, 4): from a mesh's space to the world by each joint of a skin. The node's own place counts for nothing."""
        if not joints or not all(j in self._worlds for j in joints):
            raise skin.wrong("joints", "has none, or one outside of the scene")
        with np.errstate(over="ignore", invalid="ignore"):
            bind = bind_matrices(skin, len(joints), self._accessors)
            matrices = product(np.stack([self._worlds[j] for j in joints]), bind)
        if not np.isfinite(matrices).all():
            raise skin.wrong("inverseBindMatrices", "and the joints' places give no finite numbers")
        return matrices

    def _unique(self, name: str) -> str:
        """The name, numbered where an earlier node has it: names tell objects apart."""
        self._names[name] = self._names.get(name, 0) + 1
        return name if self._names[name] == 1 else f"{name} ({self._names[name]})"

    def _add_camera(self, node: Json, world: Matrix) -> None:
        camera = node.index("camera", self._cameras)
        if camera is None:
            return
        source = self._cameras[camera]
        name = node.text("name", "") or source.text("name", "") or f"camera {camera}"
        try:
            view = read_camera(source, world)
        except SettingsError as error:
            self._shelf.warn(f"Camera {name}: {error}; it is left out.")
            return
        taken = {c.name for c in self._description.cameras}
        self._description.cameras.append(Camera(name if name not in taken else f"{name} ({len(taken) + 1})", view))
