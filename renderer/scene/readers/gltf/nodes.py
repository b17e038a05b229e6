"""The node hierarchy of a glTF file: world transforms, and the meshes, lights and cameras on nodes."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from renderer.bvh.layout import RAY_KINDS
from renderer.errors import SceneError, SettingsError
from renderer.scene.description import Camera, Instance, Light, LightLink, SceneDescription
from renderer.scene.matrices import product
from renderer.scene.readers.gltf import instancing, lights
from renderer.scene.readers.gltf.accessors import Accessors
from renderer.scene.readers.gltf.cameras import read_camera
from renderer.scene.readers.gltf.container import Json
from renderer.scene.readers.gltf.deform import bind_matrices
from renderer.scene.readers.gltf.faults import DamagedError
from renderer.scene.readers.gltf.materials import MATTES, NodeLook
from renderer.scene.readers.gltf.meshes import Meshes
from renderer.scene.readers.gltf.moving import AnimatedParts
from renderer.scene.readers.gltf.profiles import Profiles
from renderer.scene.readers.gltf.transforms import Matrix, local
from renderer.scene.textures import TextureShelf
from renderer.scene.visible_surfaces import all_hidden_note
from renderer.sentences import Sentence

__all__ = ["RAYS", "VISIBILITY", "Nodes"]

MAX_NODES = 200_000
MAX_INSTANCES = 500_000
VISIBILITY = "KHR_node_visibility"
RAYS = "RAYFARM_node_rays"  # ours: `camera` and `shadow` are false if the node's mesh is hidden from such rays


class Nodes:
    """Traverses the nodes of the default scene, and adds their meshes, lights and cameras in world space."""

    def __init__(
        self,
        root: Json,
        accessors: Accessors,
        meshes: Meshes,
        shelf: TextureShelf,
        description: SceneDescription,
        moving: AnimatedParts,
        profiles: Profiles,
    ) -> None:
        self._root, self._accessors, self._meshes, self._moving = root, accessors, meshes, moving
        self._shelf, self._description = shelf, description
        self._nodes = root.objects("nodes")
        self._cameras = root.objects("cameras")
        punctual = root.extension(lights.EXTENSION)
        self._lights = punctual.objects("lights") if punctual else []
        self._profiles = profiles
        self._skins = root.objects("skins")
        self._names: dict[str, int] = {}
        self._worlds: dict[int, Matrix] = {}  # of the scene's nodes
        self._parents: dict[int, int | None] = {}
        self._instances: dict[int, tuple[int, int]] = {}  # (first, end) in the description, by node
        self._views: dict[int, int] = {}  # index of the description's camera, by node
        self._shining: dict[int, int] = {}  # index of the description's first light, by node
        self._lacks_view = False
        self._bent: list[int] = []
        self._unskinned: set[str] = set()  # nodes whose skins are unusable
        self._taken = {camera.name for camera in description.cameras}
        self._known_joints: dict[int, tuple[list[int], bool]] = {}  # by skin, and whether any is animated
        self._carrying: dict[int, Matrix] = {}  # results of `_joints`, by skin

    def add_scene(self) -> None:
        """Adds the meshes, lights and cameras of all nodes of the scene to the description."""
        if len(self._nodes) > MAX_NODES:
            raise SceneError(
                Sentence(
                    "nodes-too-many",
                    "{file} has {count} nodes; at most {most} are allowed. Simplify it",
                    file=self._root.file,
                    count=len(self._nodes),
                    most=MAX_NODES,
                )
            )
        self._parents, shown_nodes = self._tree()
        self._moving.extend_to_children(self._parents)
        self._worlds = self._in_world(list(self._parents), {})
        for index in self._parents:
            self._add_camera(index)
        for index in shown_nodes:  # after all joints' world transforms are known
            before, shining = len(self._description.instances), len(self._description.lights)
            self._add_node(self._nodes[index], self._worlds[index], index in self._moving.nodes)
            self._instances[index] = before, len(self._description.instances)
            if len(self._description.lights) > shining:
                self._shining[index] = shining
        self._bent = [index for index in shown_nodes if self._has_animated_vertices(index)]

    def deforming(self) -> set[int]:
        """Returns the indices, in the file, of meshes whose vertices are animated, by morph weights or joints."""
        return {self._nodes[index].integer("mesh") for index in self._bent}

    def update_nodes(self, root: Json, description: SceneDescription) -> bool:
        """Updates animated transforms, shapes, lights and cameras to another moment.

        root: the file's JSON at that moment. description: a copy of the one filled by `add_scene`. Returns False if the file must
        be read again; the description is then unusable.
        """
        if self._lacks_view:
            return False
        nodes = root.value["nodes"]
        moved = [index for index in self._parents if index in self._moving.nodes]
        for index in {*moved, *self._moving.reshaped}:
            self._nodes[index] = Json(root.file, self._nodes[index].where, nodes[index], root.faults)
        self._meshes.replace_sources(root, self._moving.meshes)
        self._worlds |= self._in_world(moved, self._worlds)
        self._carrying.clear()
        for index in moved:
            world = self._worlds[index]
            if index in self._views:
                camera = self._views[index]
                try:
                    view = read_camera(self._cameras[self._nodes[index].integer("camera")], world)
                except SettingsError:
                    return False
                description.cameras[camera] = replace(description.cameras[camera], view=view)
            if index in self._shining:
                number = self._shining[index]
                moved_lights = self._lights_on(self._nodes[index], world, description.lights[number].name)
                description.lights[number : number + len(moved_lights)] = moved_lights
            first, end = self._instances.get(index, (0, 0))
            if first < end and not self._is_skinned(index):
                places = self._instance_transforms(self._nodes[index], world, end - first)
                meshes = (end - first) // len(places)
                for i in range(first, end):
                    known = description.instances[i]
                    description.instances[i] = replace(known, transform=places[(i - first) // meshes])
        for index in self._bent:
            self._replace_deformed_meshes(index, description, *self._instances[index])
        return True

    def _replace_deformed_meshes(self, index: int, description: SceneDescription, first: int, end: int) -> None:
        """Replaces the meshes of a node by their deformed shapes at the current moment.

        first, end: range of the node's instances.
        """
        node = self._nodes[index]
        matrices = None
        if self._is_skinned(index):
            matrices = self._joints(node.integer("skin"))
        shapes = self._meshes.shapes(node.integer("mesh"), node, matrices)
        numbers = [i.mesh for i in description.instances[first:end]]
        for number, shape in zip(numbers, shapes, strict=False):
            known = description.meshes[number]
            description.meshes[number] = replace(shape, material=known.material, deforms=known.deforms)

    def _is_skinned(self, index: int) -> bool:
        node = self._nodes[index]
        return node.index("skin", self._skins) is not None and not self._has_copies(node) and node.where not in self._unskinned

    @staticmethod
    def _has_copies(node: Json) -> bool:
        return node.extension(instancing.EXTENSION) is not None

    def _has_animated_vertices(self, index: int) -> bool:
        """Returns True if the vertices of a node's mesh are animated."""
        node = self._nodes[index]
        mesh = node.index("mesh", self._meshes.sources)
        if mesh is None:
            return False
        if self._moving.reshapes(mesh, node):
            return True
        if not self._is_skinned(index):
            return False
        return self._joints_of(node.integer("skin"))[1]

    def _instance_transforms(self, node: Json, world: Matrix, max_count: int) -> Matrix | list[Matrix]:
        """Returns the world transforms of a node's mesh, one per instance. Raises SceneError for more than `max_count`."""
        copies = node.extension(instancing.EXTENSION)
        if copies is None:
            return [world]
        try:
            return product(world, instancing.instance_transforms(copies, self._accessors, max_count))
        except DamagedError as fault:
            self._root.faults.add(fault)
            return [world]

    def _in_world(self, order: list[int], known_transforms: dict[int, Matrix]) -> dict[int, Matrix]:
        """Returns the world transforms of the nodes in `order`, in which each node follows its parent.

        known_transforms: world transforms of parents that are not in `order`. Whole levels of the hierarchy are processed at
        once, since files have tens of thousands of nodes.
        """
        own = dict(zip(order, local([self._nodes[index] for index in order]), strict=True))
        below = {index: parent for index in order if (parent := self._parents[index]) is not None}
        depth: dict[int, int] = {}
        levels: list[list[int]] = []
        for index in order:
            depth[index] = depth.get(below[index], 0) + 1 if index in below else 0
            while depth[index] > len(levels):
                levels.append([])
            if depth[index] == len(levels):
                levels.append([])
            levels[depth[index]].append(index)
        worlds: dict[int, Matrix] = {}
        for level in filter(None, levels):
            places = np.stack([own[index] for index in level])
            if depth[level[0]]:
                with np.errstate(over="ignore", invalid="ignore"):
                    outer = [worlds[below[i]] if below[i] in worlds else known_transforms[below[i]] for i in level]
                    places = product(np.stack(outer), places)
            bad = ~np.isfinite(places).all(axis=(1, 2))
            if bad.any():
                for i in np.flatnonzero(bad):  # replaced by the parent's transform
                    node = self._nodes[level[i]]
                    node.faults.add(
                        DamagedError(
                            node.file, node.where, Sentence("gltf-transform-not-finite", "has a transform that is not finite")
                        )
                    )
                    places[i] = outer[i] if depth[level[0]] else np.eye(4)
            worlds.update(zip(level, places, strict=True))
        return worlds

    def _tree(self) -> tuple[dict[int, int | None], list[int]]:
        """Returns the parent of each node in the scene, in an order that has parents first, and the list of visible nodes."""
        parents: dict[int, int | None] = {}
        shown_nodes: list[int] = []
        stack: list[tuple[int, int | None, bool]] = [(i, None, True) for i in reversed(self._root_nodes())]
        while stack:
            index, parent, shown = stack.pop()
            node = self._nodes[index]
            if index in parents:
                where = (
                    node.where
                    if parent is None
                    else Sentence(
                        "gltf-node-in-children",
                        "{node} in {parent}.children",
                        node=node.where,
                        parent=self._nodes[parent].where,
                    )
                )
                what = Sentence("gltf-node-shared", "has two parents or is its own ancestor; it is shown once")
                node.faults.add(DamagedError(node.file, where, what))
                continue
            parents[index] = parent
            visibility = node.extension(VISIBILITY)
            shown = shown and (visibility is None or visibility.value.get("visible") is not False)
            shown_nodes += [index] if shown else []
            stack += [(child, index, shown) for child in reversed(node.indices("children", self._nodes))]
        hidden = [self._nodes[i] for i in parents.keys() - set(shown_nodes)]
        meshes = [node for node in hidden if node.value.get("mesh") is not None]
        if meshes and not any(self._nodes[i].value.get("mesh") is not None for i in shown_nodes):
            self._shelf.warn(all_hidden_note(len(meshes)))
        return parents, shown_nodes

    def _root_nodes(self) -> list[int]:
        scenes = self._root.objects("scenes")
        if scenes:
            scene = scenes[self._root.integer("scene", 0, high=len(scenes))]
            if len(scenes) > 1:
                self._shelf.warn(
                    Sentence(
                        "gltf-scenes-left-out",
                        "{file}: {count} of its {total} scenes are left out.",
                        file=self._root.file,
                        count=len(scenes) - 1,
                        total=len(scenes),
                    )
                )
            self._description.name = scene.text("name", "") or self._description.name
            self._description.light_links |= _link_sets(scene)
            return scene.indices("nodes", self._nodes)
        children = {c for n in self._nodes for c in n.indices("children", self._nodes)}
        return [i for i in range(len(self._nodes)) if i not in children] or list(range(min(len(self._nodes), 1)))

    def _add_node(self, node: Json, world: Matrix, moves: bool) -> None:
        mesh = node.index("mesh", self._meshes.sources)
        if mesh is not None:
            name = self._unique(node.text("name", "") or self._meshes.name(mesh))
            skin = node.index("skin", self._skins)
            if self._has_copies(node):
                left = MAX_INSTANCES - len(self._description.instances)
                for i, place in enumerate(self._instance_transforms(node, world, left)):
                    self._add_instance(node, self._meshes.indices_of(mesh, node), place, f"{name} [{i}]", moves)
            elif skin is None or not self._show_skinned(node, mesh, skin, name):
                self._add_instance(node, self._meshes.indices_of(mesh, node), world, name, moves)
        self._description.lights += self._lights_on(node, world)

    def _show_skinned(self, node: Json, mesh: int, skin: int, name: str) -> bool:
        """Adds a node's mesh deformed by its skin. If the skin is unusable, counts a fault and returns False."""
        try:
            found = self._meshes.skinned(mesh, node, self._joints(skin), self._joints_of(skin)[1])
        except DamagedError as fault:
            self._root.faults.add(fault)
            self._unskinned.add(node.where)
            return False
        self._add_instance(node, found, np.eye(4), name, self._moving.appears(node))
        return True

    def _lights_on(self, node: Json, world: Matrix, name: str = "") -> list[Light]:
        """Returns the lights on a node, called `name` if given; an unusable light is counted as a fault."""
        try:
            return self._read_lights(node, world, name)
        except DamagedError as fault:
            self._root.faults.add(fault)
            return []

    def _read_lights(self, node: Json, world: Matrix, name: str) -> list[Light]:
        found = []
        name = name or node.text("name", "")
        spare = f"light {len(self._description.lights)}"
        light = node.extension(lights.EXTENSION)
        if light:
            source = self._lights[light.integer("light", high=len(self._lights))]
            name = name or source.text("name", "") or spare
            found.append(_linked(lights.read_light(source, name, world), source))
        shaped = self._profiles.light(node, name or spare, world)
        found += [] if shaped is None else [shaped]
        return [_linked(light, node) for light in found]

    def _add_instance(self, node: Json, meshes: list[int], place: Matrix, name: str, moves: bool) -> None:
        restless = self._meshes.restless
        self._description.instances += [
            Instance(m, place, self._material_of(node, m), name, moves or m in restless) for m in meshes
        ]

    def _material_of(self, node: Json, mesh: int) -> int | None:
        """Returns the index of a material to use in place of a mesh's own; None if the mesh keeps its own.

        A replacement is needed if some kinds of rays ignore the node, if it is a holdout or a catcher, or if it has a
        light group or a link set.
        """
        rays = node.extension(RAYS)
        seen_by = node.names_in_extras("visible_to", RAY_KINDS)
        hidden = [
            kind
            for kind in RAY_KINDS
            if (rays is not None and rays.value.get(kind) is False) or (seen_by is not None and kind not in seen_by)
        ]
        held, shadows, reflections = (node.flag_in_extras(key) for key in MATTES)
        named = (node.name_in_extras(key) for key in ("light_group", "light_link", "shadow_link"))
        look = NodeLook(tuple(hidden), held, shadows, reflections, *named)
        return self._meshes.material_of_node(mesh, look) if any(look) else None

    def _joints_of(self, number: int) -> tuple[list[int], bool]:
        """Returns the joint nodes of a skin, and whether any of them is animated."""
        if number not in self._known_joints:
            joints = self._skins[number].indices("joints", self._nodes)
            self._known_joints[number] = joints, not self._moving.nodes.isdisjoint(joints)
        return self._known_joints[number]

    def _joints(self, number: int) -> Matrix:
        """Returns (J, 4, 4) transforms from mesh space to world space, one per joint of a skin.

        The transform of the node with the mesh is ignored, as the specification requires.
        """
        if number not in self._carrying:
            self._carrying[number] = self._skin_matrices(self._skins[number], self._joints_of(number)[0])
        return self._carrying[number]

    def _skin_matrices(self, skin: Json, joints: list[int]) -> Matrix:
        if not joints or not all(j in self._worlds for j in joints):
            raise skin.damage("joints", Sentence("gltf-skeleton-node-missing", "has no nodes, or a node outside of the scene"))
        with np.errstate(over="ignore", invalid="ignore"):
            bind = bind_matrices(skin, len(joints), self._accessors)
            matrices = product(np.stack([self._worlds[j] for j in joints]), bind)
        if not np.isfinite(matrices).all():
            raise skin.damage(
                "inverseBindMatrices",
                Sentence("gltf-joints-not-finite", "with the joints' transforms gives numbers that are not finite"),
            )
        return matrices

    def _unique(self, name: str) -> str:
        """Returns an object's name, with a number appended if an earlier object has the same name."""
        self._names[name] = self._names.get(name, 0) + 1
        return name if self._names[name] == 1 else f"{name} ({self._names[name]})"

    def _add_camera(self, index: int) -> None:
        node, world = self._nodes[index], self._worlds[index]
        camera = node.index("camera", self._cameras)
        if camera is None:
            return
        source = self._cameras[camera]
        name = node.text("name", "") or source.text("name", "") or f"camera {camera}"
        try:
            view = read_camera(source, world)
        except SettingsError as error:
            self._shelf.warn(Sentence("camera-left-out", "Camera {name}: {error}; it is left out.", name=name, error=error))
            self._lacks_view = True
            return
        self._views[index] = len(self._description.cameras)
        taken = self._taken
        name = name if name not in taken else f"{name} ({len(self._description.cameras) + 1})"
        taken.add(name)
        self._description.cameras.append(Camera(name, view))


def _linked(light: Light, source: Json) -> Light:
    """Returns the light with the light group and the link sets that the extras of a glTF object name, if they name any."""
    group, link, shadow = (source.name_in_extras(key) for key in ("light_group", "light_link", "shadow_link"))
    return replace(
        light,
        light_group=group or light.light_group,
        light_link=link or light.light_link,
        shadow_link=shadow or light.shadow_link,
    )


def _link_sets(scene: Json) -> dict[str, LightLink]:
    """Returns the link sets in `light_links` of the extras of a glTF scene; unusable ones are counted as faults."""
    extras = scene.value.get("extras")
    found: Any = extras.get("light_links", {}) if isinstance(extras, dict) else {}
    links = {}
    for name, link in found.items() if isinstance(found, dict) else ():
        lists = [link.get(key) for key in ("include", "exclude")] if isinstance(link, dict) else []
        if not lists or not all(
            names is None or (isinstance(names, list) and all(isinstance(each, str) for each in names)) for names in lists
        ):
            scene.fault("extras", Sentence("gltf-light-links-invalid", "has light_links that are not lists of object names"))
            continue
        include, exclude = lists
        links[name] = LightLink(None if include is None else tuple(include), tuple(exclude or ()))
    return links
