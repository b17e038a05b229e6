"""From Blender's dependency graph to a scene: what is evaluated, each mesh once, each place it is shown at.

It is a generator that rests between meshes, so that a viewport's main thread can go on with it a few milliseconds at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from . import lights
from .meshes import Corners, extract, shape
from .model import Mesh, Node, Scene
from .surfaces import Surfaces
from .world import read_world

__all__ = ["Known", "gather", "over_the_shutter"]

F64 = npt.NDArray[np.float64]
SURFACES = ("MESH", "CURVE", "SURFACE", "META", "FONT")
LEFT_OUT = {
    "VOLUME": "volumes",
    "CURVES": "hair curves",
    "POINTCLOUD": "point clouds",
    "GPENCIL": "grease pencil",
    "GREASEPENCIL": "grease pencil",
    "LIGHT_PROBE": None,
    "EMPTY": None,
    "ARMATURE": None,
    "LATTICE": None,
    "CAMERA": None,
    "SPEAKER": None,
    "LIGHT": None,
}
Known = dict[str, tuple[Mesh, Corners] | None]


class _Gathering:
    def __init__(self, scene: Scene, known: Known, changed: Callable[[Any, Any], bool]) -> None:
        self.scene, self.known, self._changed = scene, known, changed
        self._keys: dict[int, str] = {}  # by where the mesh lies in memory
        self._taken: dict[str, int] = {}
        self._names: dict[str, int] = {}
        self.made: set[str] = set()
        self.places: dict[Any, Node] = {}  # by what tells an instance at another moment
        self.primary: set[str] = set()
        self.surfaces = Surfaces(scene, self.primary)

    def instance(self, found: Any) -> bool:
        """Takes one in; whether that took time."""
        thing = found.object
        if not found.show_self:
            return False
        if thing.type == "LIGHT":
            lights.add_light(self.scene, thing, self._unique(thing.name), _matrix(found.matrix_world))
            return False
        if thing.type not in SURFACES:
            what = LEFT_OUT.get(thing.type, thing.type.lower())
            if what:
                self.scene.warn(f"{thing.name}: {what} are left out.")
            return False
        self._told(thing)
        made, key = self._mesh(thing)
        if self.known.get(key) is None:
            return made
        materials = tuple(
            self.surfaces.add(slot.material) if slot.material is not None else self._plain() for slot in thing.material_slots
        )
        place = _matrix(found.matrix_world)
        node = Node(self._unique(thing.name), key, materials or (self._plain(),), place, number=thing.pass_index)
        self.scene.nodes.append(node)
        self.places[_identity(found)] = node
        return made

    def _told(self, thing: Any) -> None:
        for flag, what in (("is_holdout", "a holdout"), ("is_shadow_catcher", "a shadow catcher")):
            if getattr(thing, flag, False):
                self.scene.warn(f"{thing.name}: is {what} in Blender, and shown as any other object.")
        kinds = ("camera", "diffuse", "glossy", "transmission", "shadow")
        if not all(getattr(thing, f"visible_{kind}", True) for kind in kinds):
            self.scene.warn(f"{thing.name}: is seen by all rays, though Blender hides it from some.")

    def _plain(self) -> str:
        """What has no material is grey."""
        key = "\0none"
        if key not in self.scene.materials:
            from .model import Material

            grey = {"baseColorFactor": [0.8, 0.8, 0.8, 1], "metallicFactor": 0, "roughnessFactor": 1}
            said = {"doubleSided": True, "pbrMetallicRoughness": grey}
            said["extensions"] = {"KHR_materials_specular": {"specularFactor": 0}}
            self.scene.materials[key] = Material("no material", said)
        return key

    def _mesh(self, thing: Any) -> tuple[bool, str]:
        data = thing.data
        is_mesh = thing.type == "MESH"
        pointer = data.as_pointer() if is_mesh else thing.as_pointer()
        if pointer in self._keys:
            return False, self._keys[pointer]
        name = data.name_full if data is not None else thing.name_full
        count = self._taken[name] = self._taken.get(name, 0) + 1
        key = self._keys[pointer] = name if count == 1 else f"{name}#{count}"
        if key in self.known and not self._changed(thing, data):
            self._note_uvs(data if is_mesh else None)
            self._keep(key)
            return False, key
        source = data if is_mesh else thing.to_mesh()
        try:
            self._note_uvs(source)
            self.known[key] = None if source is None else extract(source, key, self._color_of(thing))
        finally:
            if not is_mesh:
                thing.to_mesh_clear()
        self.made.add(key)
        self._keep(key)
        return True, key

    def _keep(self, key: str) -> None:
        found = self.known[key]
        if found is not None:
            self.scene.meshes[key] = found[0]

    def _note_uvs(self, source: Any) -> None:
        if source is not None and hasattr(source, "uv_layers"):
            self.primary.update(layer.name for layer in source.uv_layers if layer.active_render)

    def _color_of(self, thing: Any) -> str | None:
        """The colour attribute that the first material with one reads."""
        for slot in thing.material_slots:
            if slot.material is not None:
                name = self.surfaces.colors.get(self.surfaces.add(slot.material))
                if name is not None:
                    return name
        return None

    def _unique(self, name: str) -> str:
        """Told from others of the name, as names tell objects apart at the farm."""
        count = self._names[name] = self._names.get(name, 0) + 1
        return name if count == 1 else f"{name} ({count})"


def gather(depsgraph: Any, known: Known, changed: Callable[[Any, Any], bool] = lambda thing, data: True) -> Iterator[_Gathering]:
    """Yields itself as it goes on, in the end complete. known: meshes of before, by key; of these, those stay that did not
    change. changed: whether an object's mesh (given the object and its data) is another since.
    """
    scene = Scene()
    found = _Gathering(scene, known, changed)
    for number, instance in enumerate(depsgraph.object_instances):
        if found.instance(instance) or number % 256 == 255:
            yield found
    blender = depsgraph.scene
    scene.world = read_world(scene, blender.world)
    _look_at_the_scene(scene, blender)
    for key in [key for key in known if key not in scene.meshes and key not in found.made]:
        del known[key]
    yield found


def _look_at_the_scene(scene: Scene, blender: Any) -> None:
    if blender.render.film_transparent:
        scene.warn("Transparent film: the farm's pictures have the world behind them, and no alpha.")
    if abs(blender.render.pixel_aspect_x - blender.render.pixel_aspect_y) > 1e-6:
        scene.warn("Pixels that are not square are rendered as square ones.")
    if blender.render.use_simplify and getattr(blender.render, "simplify_subdivision_render", 6) < 6:
        scene.warn("Simplify is on: surfaces are as smooth as it lets them be.")


def over_the_shutter(found: _Gathering, keys: Sequence[tuple[float, Callable[[], Any]]]) -> None:
    """Adds where all that was gathered is while the shutter is open.

    keys: seconds of the file's clock, and what moves Blender there and gives its dependency graph.
    """
    scene = found.scene
    scene.times = tuple(time for time, _ in keys)
    places: dict[int, list[F64]] = {id(node): [] for node in scene.nodes}
    shapes: dict[str, list[Any]] = {key: [] for key in scene.meshes}
    for _, go in keys:
        seen: set[str] = set()
        for instance in go().object_instances:
            node = found.places.get(_identity(instance))
            if node is None:
                continue
            places[id(node)].append(_matrix(instance.matrix_world))
            if node.mesh not in seen:
                seen.add(node.mesh)
                shapes[node.mesh].append(_shape_of(instance.object, found.known[node.mesh]))
    for node in scene.nodes:
        told = places[id(node)]
        if len(told) == len(keys) and any(np.abs(each - node.place).max() > 1e-7 for each in told):
            node.places = tuple(told)
    for key, over in shapes.items():
        mesh = scene.meshes[key]
        if len(over) != len(keys) or any(each is None for each in over):
            scene.warn(f"{key}: is cut otherwise while the shutter is open, and not blurred.")
        elif any(np.abs(each[0] - mesh.positions).max(initial=0) > 1e-7 for each in over):
            middle = over[len(over) // 2]
            mesh.positions, mesh.normals = middle
            mesh.shapes = tuple(over)


def _shape_of(thing: Any, known: tuple[Mesh, Corners] | None) -> Any:
    if known is None:
        return None
    if thing.type == "MESH":
        return shape(thing.data, known[1])
    source = thing.to_mesh()
    try:
        return None if source is None else shape(source, known[1])
    finally:
        thing.to_mesh_clear()


def _identity(found: Any) -> Any:
    parent = found.parent.name_full if found.is_instance and found.parent is not None else None
    return found.object.name_full, parent, tuple(found.persistent_id) if found.is_instance else ()


def _matrix(matrix: Any) -> F64:
    return np.array(matrix, np.float64)
