"""Exports Blender's dependency graph to a Scene: evaluated meshes, each once, and their instances.

The export is a generator that yields between meshes, so that a viewport can run it in Blender's main thread for a few
milliseconds at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from . import lights
from .cycles import Flags, warn_of_passes, warn_of_settings, warn_of_volumes
from .lights import is_linked_to_lights
from .meshes import Corners, extract, hair, particle_hair, shape, stretched
from .model import Mesh, Node, Scene
from .particles import hair_systems
from .subsurface import has_volumes
from .surfaces import Surfaces
from .world import Bake, read_world

__all__ = ["ExportedMeshes", "export_scene", "extends_beyond_clip_end", "over_the_shutter"]

F64 = npt.NDArray[np.float64]
SURFACES = ("MESH", "CURVE", "SURFACE", "META", "FONT", "CURVES")
LEFT_OUT = {
    "VOLUME": "volumes",
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
# The kinds of rays, and Blender's flags for whether they hit an object.
RAYS = {
    "camera": "visible_camera",
    "shadow": "visible_shadow",
    "diffuse": "visible_diffuse",
    "glossy": "visible_glossy",
    "transmission": "visible_transmission",
    "volume": "visible_volume_scatter",
}
FILTER = "blackman-harris"  # default
ExportedMeshes = dict[str, tuple[Mesh, Corners] | None]


class _Density:
    """A callable that returns how long a mesh's surface is, in world units, per unit of a UV set: (across, up).

    The callable returns None if the mesh lacks that UV set.
    """

    def __init__(self, mesh: Mesh, place: F64) -> None:
        self._mesh = mesh
        self.scale = float(abs(np.linalg.det(place[:3, :3]))) ** (1 / 3)

    def __call__(self, uv_set: int) -> tuple[float, float] | None:
        found = stretched(self._mesh, uv_set)
        return None if found is None else (found[0] * self.scale, found[1] * self.scale)


class _SceneExport:
    def __init__(self, scene: Scene, exported: ExportedMeshes, changed: Callable[[Any, Any], bool], graph: Any) -> None:
        layer = graph.view_layer
        self.scene, self.known, self._changed, self._layer = scene, exported, changed, layer
        self.flags = Flags(graph.scene, layer)
        self._is_transparent = bool(graph.scene.render.film_transparent)
        self._override = getattr(layer, "material_override", None)  # replaces all materials of the view layer
        self._keys: dict[int, str] = {}  # by the mesh's address in memory
        self._taken: dict[str, int] = {}
        self._names: dict[str, int] = {}
        self.made: set[str] = set()
        self.places: dict[Any, list[Node]] = {}  # by the identity of an instance at all times
        self.systems: dict[str, str] = {}  # by the key of a mesh of particle hair: the name of its system
        self.for_render = graph.mode == "RENDER"
        self.primary: set[str] = set()
        self.surfaces = Surfaces(scene, self.primary)

    def instance(self, found: Any) -> bool:
        """Exports an instance of the dependency graph; returns True if this converted a mesh, which takes time."""
        thing = found.object
        if not (found.show_self or found.show_particles):
            return False
        if thing.type in (*SURFACES, "LIGHT") and not np.isfinite(_matrix(found.matrix_world)).all():
            self.scene.warn(f"{thing.name}: lies at a place that is no number, and is left out.")
            return False
        if thing.type == "LIGHT":
            lights.add_light(self.scene, thing, self._unique(thing.name), _matrix(found.matrix_world))
            return False
        if thing.type not in SURFACES:
            what = LEFT_OUT.get(thing.type, thing.type.lower())
            if what:
                self.scene.warn(f"{thing.name}: {what} are left out.")
            return False
        seen = self._rays(found, thing)
        if not any(seen.values()):
            return False
        self.flags.inspect(thing)
        place, made = _matrix(found.matrix_world), False
        if found.show_self:
            made, key = self._mesh(thing, place)
            if self.known.get(key) is not None:
                self._add_node(found, thing.name, key, None, seen)
            elif thing.type == "CURVES" and len(thing.data.points):
                self.scene.warn(f"{thing.name}: is hair of too many points, and left out.")
        if found.show_particles:
            for system in hair_systems(thing, self.for_render):
                converted, key = self._particle_hair(thing, system)
                made = made or converted
                if self.known.get(key) is not None:
                    self._add_node(found, f"{thing.name} {system.name}", key, system.settings.material - 1, seen)
                elif len(system.particles):
                    self.scene.warn(f"{thing.name}: has hair of too many points, which is left out.")
        return made

    def _add_node(self, found: Any, name: str, key: str, slot: int | None, seen: dict[str, bool]) -> None:
        """Adds a node that shows a known mesh. slot: the index of its only material among the object's, None for all of them."""
        thing, place = found.object, _matrix(found.matrix_world)
        known = self.known[key]
        assert known is not None
        density = _Density(known[0], place)
        shown = [self._override or each.material for each in thing.material_slots] or [self._override]
        if slot is not None:
            shown = [shown[min(max(slot, 0), len(shown) - 1)]]
        materials = tuple(self._default_material() if each is None else self.surfaces.add(each, density) for each in shown)
        matte, hidden = self._matte(thing), tuple(kind for kind, is_seen in seen.items() if not is_seen)
        node = Node(self._unique(name), key, materials, place, number=thing.pass_index, hidden_from=hidden, matte=matte)
        self.scene.nodes.append(node)
        self.places.setdefault(_identity(found), []).append(node)

    def _particle_hair(self, thing: Any, system: Any) -> tuple[bool, str]:
        """Returns whether the hair of a particle system had to be converted, and the key of its mesh."""
        pointer = system.as_pointer()
        if pointer in self._keys:
            return False, self._keys[pointer]
        name = f"{thing.name_full} {system.name}"
        count = self._taken[name] = self._taken.get(name, 0) + 1
        key = self._keys[pointer] = name if count == 1 else f"{name}#{count}"
        self.systems[key] = system.name
        is_new = key not in self.known or self._changed(thing, thing.data)
        if is_new:
            self.known[key] = particle_hair(thing, system, self.for_render, key)
            self.made.add(key)
        self._add_known_mesh(key)
        return is_new, key

    def _rays(self, found: Any, thing: Any) -> dict[str, bool]:
        """Returns a dict of kind of ray -> whether such rays hit the object. Warns of light linking, which is not exported.

        An object is hit only if neither it nor its instancer hides it from such rays.
        """
        owners = [thing] if not found.is_instance or found.parent is None else [thing, found.parent]
        seen = {kind: all(getattr(each, flag, True) for each in owners) for kind, flag in RAYS.items()}
        layer = self._layer
        if layer is not None and thing.original.indirect_only_get(view_layer=layer):
            seen["camera"] = False
        if is_linked_to_lights(thing):
            self.scene.warn(f"{thing.name}: lights all that it reaches (light linking is left out).")
        return seen

    def _matte(self, thing: Any) -> str:
        """Returns the `matte` of an object's Node. Before an opaque film the object is an ordinary one, with a warning."""
        layer = self._layer
        if getattr(thing, "is_holdout", False) or (layer is not None and thing.original.holdout_get(view_layer=layer)):
            matte, what = "holdout", "a holdout"
        elif getattr(thing, "is_shadow_catcher", False):
            matte, what = "shadow_catcher", "a shadow catcher"
        else:
            return ""
        if self._is_transparent:
            return matte
        self.scene.warn(f"{thing.name}: is {what} in Blender, and shown as any other object.")
        return ""

    def _default_material(self) -> str:
        """Returns the key of the grey material for objects without a material."""
        key = "\0none"
        if key not in self.scene.materials:
            from .model import Material

            grey = {"baseColorFactor": [0.8, 0.8, 0.8, 1], "metallicFactor": 0, "roughnessFactor": 1}
            said = {"doubleSided": True, "pbrMetallicRoughness": grey}
            said["extensions"] = {"KHR_materials_specular": {"specularFactor": 0}}
            self.scene.materials[key] = Material("no material", said)
        return key

    def _mesh(self, thing: Any, place: F64) -> tuple[bool, str]:
        data = thing.data
        is_mesh, is_hair = thing.type == "MESH", thing.type == "CURVES"
        pointer = data.as_pointer() if is_mesh else thing.as_pointer()
        if pointer in self._keys:
            return False, self._keys[pointer]
        name = data.name_full if data is not None else thing.name_full
        count = self._taken[name] = self._taken.get(name, 0) + 1
        key = self._keys[pointer] = name if count == 1 else f"{name}#{count}"
        if key in self.known and not self._changed(thing, data):
            self._note_uvs(data if is_mesh else None)
            self._add_known_mesh(key)
            return False, key
        source = data if is_mesh or is_hair else thing.to_mesh()
        try:
            self._note_uvs(source)
            made = None if source is None else hair(source, key) if is_hair else extract(source, key)
            color = None if made is None else self._color_of(thing, _Density(made[0], place))
            self.known[key] = made if color is None else extract(source, key, color)
        finally:
            if not (is_mesh or is_hair):
                thing.to_mesh_clear()
        self.made.add(key)
        self._add_known_mesh(key)
        return True, key

    def _add_known_mesh(self, key: str) -> None:
        found = self.known[key]
        if found is not None:
            self.scene.meshes[key] = found[0]

    def _note_uvs(self, source: Any) -> None:
        if source is not None and hasattr(source, "uv_layers"):
            self.primary.update(layer.name for layer in source.uv_layers if layer.active_render)

    def _color_of(self, thing: Any, density: _Density) -> str | None:
        """Returns the name of the colour attribute that the object's materials use (the first one found); None if none does."""
        for slot in thing.material_slots:
            material = self._override or slot.material
            if material is not None:
                name = self.surfaces.colors.get(self.surfaces.add(material, density))
                if name is not None:
                    return name
        return None

    def _unique(self, name: str) -> str:
        """Returns `name` made unique among the exported objects, since the farm identifies objects by name."""
        count = self._names[name] = self._names.get(name, 0) + 1
        return name if count == 1 else f"{name} ({count})"


def export_scene(
    depsgraph: Any,
    exported: ExportedMeshes,
    changed: Callable[[Any, Any], bool] = lambda thing, data: True,
    bake: Bake | None = None,
) -> Iterator[_SceneExport]:
    """Exports the scene step by step: yields the unfinished export after each step, and finally the complete one.

    exported: meshes of earlier exports by key; unchanged ones are reused. changed: returns whether an object's mesh has changed,
    given the object and its data. bake: as for `read_world`.
    """
    scene = Scene()
    found = _SceneExport(scene, exported, changed, depsgraph)
    for number, instance in enumerate(depsgraph.object_instances):
        if found.instance(instance) or number % 256 == 255:
            yield found
    blender = depsgraph.scene
    scene.world = read_world(scene, getattr(depsgraph.view_layer, "world_override", None) or blender.world, bake)
    own = blender.rayfarm
    taken = {"is_clamped": own.clamp > 0, "has_filter": own.filter != FILTER}
    warn_of_settings(blender, depsgraph.view_layer, scene.add_warning, **taken)
    if has_volumes(scene):
        warn_of_volumes(blender, scene.add_warning)
    warn_of_passes(depsgraph.view_layer, scene.add_warning)
    found.flags.warn_of_found(scene.add_warning)
    for key in [key for key in exported if key not in scene.meshes and key not in found.made]:
        del exported[key]
    yield found


def extends_beyond_clip_end(scene: Scene, eye: F64, forward: F64, end: float) -> bool:
    """Returns True if a visible object extends beyond the camera's clip end, which the export ignores.

    eye, forward: of the camera, in Blender's axes. end: distance of the clip end.
    """
    seen = [node for node in scene.nodes if "camera" not in node.hidden_from]
    if not seen:
        return False
    of = {key: np.stack([mesh.positions.min(axis=0), mesh.positions.max(axis=0)]) for key, mesh in scene.meshes.items()}
    which = np.indices((2, 2, 2)).reshape(3, 8)
    corners = {key: ends[which.T, np.arange(3)] for key, ends in of.items()}
    places = np.stack([node.place for node in seen])
    at = np.einsum("nij,nkj->nki", places[:, :3, :3], np.stack([corners[node.mesh] for node in seen])) + places[:, None, :3, 3]
    return bool(((at - eye) @ forward).max() > end)


def over_the_shutter(found: _SceneExport, keys: Sequence[tuple[float, Callable[[], Any]]]) -> None:
    """Adds transforms and vertices at the shutter's keys to all exported objects.

    found: the export. keys: for each key the time in seconds and a function that sets Blender to that time and returns its
    dependency graph.
    """
    scene = found.scene
    scene.times = tuple(time for time, _ in keys)
    places: dict[int, list[F64]] = {id(node): [] for node in scene.nodes}
    shapes: dict[str, list[Any]] = {key: [] for key in scene.meshes}
    for _, go in keys:
        seen: set[str] = set()
        for instance in go().object_instances:
            for node in found.places.get(_identity(instance), ()):
                places[id(node)].append(_matrix(instance.matrix_world))
                if node.mesh not in seen:
                    seen.add(node.mesh)
                    shapes[node.mesh].append(_shape_at(instance.object, found, node.mesh))
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


def _shape_at(thing: Any, export: _SceneExport, key: str) -> Any:
    """Returns the positions and normals of an exported mesh as its object now is; None if it is divided otherwise."""
    exported, name = export.known[key], export.systems.get(key)
    if name is None or exported is None:
        return _shape_of(thing, exported)
    for system in hair_systems(thing, export.for_render):
        if system.name == name:
            made = particle_hair(thing, system, export.for_render, key, exported[1])
            return None if made is None or made[1].counts != exported[1].counts else (made[0].positions, made[0].normals)
    return None


def _shape_of(thing: Any, exported: tuple[Mesh, Corners] | None) -> Any:
    if exported is None:
        return None
    if thing.type == "CURVES":
        made = hair(thing.data, exported[0].key, exported[1])
        return None if made is None or made[1].counts != exported[1].counts else (made[0].positions, made[0].normals)
    if thing.type == "MESH":
        return shape(thing.data, exported[1])
    source = thing.to_mesh()
    try:
        return None if source is None else shape(source, exported[1])
    finally:
        thing.to_mesh_clear()


def _identity(found: Any) -> Any:
    parent = found.parent.name_full if found.is_instance and found.parent is not None else None
    return found.object.name_full, parent, tuple(found.persistent_id) if found.is_instance else ()


def _matrix(matrix: Any) -> F64:
    return np.array(matrix, np.float64)
