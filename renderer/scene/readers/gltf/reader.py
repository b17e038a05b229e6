"""A glTF file as a scene: its hierarchy of nodes, and what hangs on them."""

from __future__ import annotations

import numpy as np

from renderer.errors import SceneError, SettingsError
from renderer.scene.description import Camera, Instance, SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.readers.gltf import draco, instancing, lights, materials, textures, variants
from renderer.scene.readers.gltf.accessors import Accessors
from renderer.scene.readers.gltf.cameras import read_camera
from renderer.scene.readers.gltf.container import Json, parse
from renderer.scene.readers.gltf.deform import bind_matrices
from renderer.scene.readers.gltf.meshes import Meshes
from renderer.scene.readers.gltf.transforms import Matrix, local
from renderer.scene.textures import TextureShelf

__all__ = ["read"]

MAX_NODES = 200_000
MAX_INSTANCES = 500_000

_VISIBILITY = "KHR_node_visibility"

_READ = {
    draco.EXTENSION,
    instancing.EXTENSION,
    lights.EXTENSION,
    _VISIBILITY,
    variants.EXTENSION,
    "KHR_mesh_quantization",
    *materials.EXTENSIONS,
    *textures.EXTENSIONS,
}
# These change nothing of the one picture that is rendered: notes, and animation's targets.
_WITHOUT_EFFECT = {"KHR_xmp_json_ld", "KHR_animation_pointer"}


def read(files: SceneFiles, main: str, description: SceneDescription, variant: str | None = None) -> None:
    """Adds the file's default scene to the description, with its own materials or those of a variant. Raises SceneError."""
    root, binary = parse(files.read(main), main)
    shelf = TextureShelf(description, files)
    _check_extensions(root, shelf)
    accessors = Accessors(root, binary, files)
    surfaces = materials.Materials(root, textures.Textures(root, accessors, files, shelf), shelf, description.materials)
    chosen = variants.Variants(root, variant)
    description.variants = chosen.names
    meshes = Meshes(root, accessors, surfaces, chosen, shelf, description.meshes)
    _Nodes(root, accessors, meshes, shelf, description).walk()
    for i, animation in enumerate(root.objects("animations")):
        description.animations.append(animation.text("name", "") or f"animation {i}")
    if description.animations:
        shelf.warn("Animations are named but not evaluated yet; the file's rest pose is rendered.")


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
        self, root: Json, accessors: Accessors, meshes: Meshes, shelf: TextureShelf, description: SceneDescription
    ) -> None:
        self._root, self._accessors, self._meshes = root, accessors, meshes
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
        nodes = [self._nodes[index] for index in parents]
        for (index, parent), node, own in zip(parents.items(), nodes, local(nodes), strict=True):
            world = (np.eye(4) if parent is None else self._worlds[parent]) @ own
            if not np.isfinite(world).all():
                raise SceneError(f"{self._root.file}: {node.where} has a transform that is not finite; export the file again")
            self._worlds[index] = world
            self._add_camera(node, world)
        for index in shown_nodes:  # when all joints are in their places
            self._place(self._nodes[index], self._worlds[index])

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

    def _place(self, node: Json, world: Matrix) -> None:
        mesh = node.index("mesh", self._meshes.sources)
        if mesh is not None:
            name = self._unique(node.text("name", "") or self._meshes.name(mesh))
            copies = node.extension(instancing.EXTENSION)
            skin = node.index("skin", self._skins)
            if copies:
                left = MAX_INSTANCES - len(self._description.instances)
                places = world @ instancing.instance_transforms(copies, self._accessors, left)
                for i, place in enumerate(places):
                    self._show(self._meshes.of(mesh, node), place, f"{name} [{i}]")
            elif skin is not None:
                self._show(self._meshes.skinned(mesh, node, self._joints(self._skins[skin])), np.eye(4), name)
            else:
                self._show(self._meshes.of(mesh, node), world, name)
        light = node.extension(lights.EXTENSION)
        if light:
            source = self._lights[light.integer("light", high=len(self._lights))]
            name = node.text("name", "") or source.text("name", "") or f"light {len(self._description.lights)}"
            self._description.lights.append(lights.read_light(source, name, world))

    def _show(self, meshes: list[int], place: Matrix, name: str) -> None:
        self._description.instances += [Instance(m, place, name=name) for m in meshes]

    def _joints(self, skin: Json) -> Matrix:
        """(J, 4, 4): from a mesh's space to the world by each joint of a skin. The node's own place counts for nothing."""
        joints = skin.indices("joints", self._nodes)
        if not joints or not all(j in self._worlds for j in joints):
            raise skin.wrong("joints", "has none, or one outside of the scene")
        with np.errstate(over="ignore", invalid="ignore"):
            matrices = np.stack([self._worlds[j] for j in joints]) @ bind_matrices(skin, len(joints), self._accessors)
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
