"""Adds shapes with their materials and area lights to the world, and instances of objects."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from renderer.scene.description import Instance, Mesh, SceneDescription, Sphere
from renderer.scene.files import SceneFiles
from renderer.scene.matrices import Matrix, product
from renderer.scene.normals import face_normals
from renderer.scene.readers.height_maps import rounded, spans_of
from renderer.scene.readers.pbrt.curves import is_flat, strand_of
from renderer.scene.readers.pbrt.expansion_limits import TriangleBudget
from renderer.scene.readers.pbrt.lights import Lights
from renderer.scene.readers.pbrt.mappings import mapped
from renderer.scene.readers.pbrt.materials import Emission, Materials, is_nothing
from renderer.scene.readers.pbrt.media import Interface
from renderer.scene.readers.pbrt.meshes import MESHES, flipped, mesh_of, with_uvs
from renderer.scene.readers.pbrt.notes import Notes, Place
from renderer.scene.readers.pbrt.parameters import Parameters
from renderer.scene.readers.pbrt.quadrics import QUADRICS, Quadric, quadric, shape_key, whole_sphere
from renderer.scene.readers.pbrt.textures import Textures, Varying
from renderer.scene.readers.pbrt.transforms import Ctm, interpolate
from renderer.scene.readers.strands import Strand, strands_mesh
from renderer.sentences import Sentence

__all__ = ["Part", "ShapeState", "Shapes"]

_MOST_INSTANCES = 500_000
_ROUND = 1e-4
_UNSEEN = Varying((0.0, 0.0, 0.0))


class ShapeState(NamedTuple):
    """The part of the graphics state that applies to a shape: transformation, material, area light, orientation and media."""

    ctm: Ctm
    material: Parameters | None
    area: Parameters | None  # its area light
    reverse: bool
    medium: Interface = ("", "")  # (inside, outside)


class Part(NamedTuple):
    """A mesh of the description, or a sphere, with its transformation.

    mesh: the mesh's index in the description; negative for spheres.
    """

    mesh: int
    ctm: Ctm
    name: str
    radius: float = 0.0
    material: int = 0


class Shapes:
    """Adds shapes to a description.

    outer: transformation of the whole world; time: the moment, as a fraction of the interval between pbrt's start and end times.
    """

    def __init__(
        self,
        files: SceneFiles,
        materials: Materials,
        lights: Lights,
        textures: Textures,
        description: SceneDescription,
        notes: Notes,
        outer: Matrix,
        time: float,
    ) -> None:
        self._files, self._materials, self._lights, self._textures = files, materials, lights, textures
        self._description, self._notes, self._outer, self._time = description, notes, outer, time
        self.objects: dict[str, list[Part]] = {}
        self._open: list[Part] | None = None
        self._quadrics: dict[tuple[object, ...], int] = {}  # mesh index by shape
        self._strands: dict[tuple[int, bool, bytes, bytes], tuple[list[Strand], Ctm]] = {}
        self._places: dict[str, np.ndarray] = {}  # (N, 4, 4) transforms of the parts, by object
        self._made: dict[tuple[object, ...], Quadric] = {}
        self._balls: dict[int, int] = {}  # mesh index of complete spheres, by material
        self._growth = TriangleBudget()

    def begin(self, name: str) -> None:
        """Begins the definition of an object, to which the following shapes are added."""
        self.flush()
        self._open = self.objects[name] = []
        self._places.pop(name, None)

    def end_object(self) -> None:
        """Ends the definition of the open object."""
        self.flush()
        self._open = None

    @property
    def in_object(self) -> bool:
        """True between ObjectBegin and ObjectEnd."""
        return self._open is not None

    def instance(self, name: str, ctm: Ctm, place: Place) -> None:
        """Adds an instance of an object to the world. Raises SceneError if the object is undefined."""
        if name not in self.objects:
            raise place.error(
                Sentence(
                    "pbrt-object-undefined",
                    "there is no object {name}; define it with ObjectBegin first",
                    name=repr(name[:60]),
                )
            )
        parts = self.objects[name]
        self._make_room(len(parts), place)
        if name not in self._places:
            inner = [interpolate(part.ctm, self._time) for part in parts]
            self._places[name] = np.stack(inner) if inner else np.zeros((0, 4, 4))
        worlds = product(product(self._outer, interpolate(ctm, self._time)), self._places[name])
        stands = ctm[0] is ctm[1]
        for part, world in zip(parts, worlds, strict=True):
            self._add_instance(part, world, moves=not stands or part.ctm[0] is not part.ctm[1], is_within=True)

    def add(self, source: Parameters, state: ShapeState) -> None:
        """Adds a shape to the world, or to the open object."""
        if source.type not in (*MESHES, *QUADRICS, "curve"):
            source.used.update(source.values)
            self._notes.add(
                source.place,
                Sentence("shape-type-unsupported", "{what} is not supported as a shape: it is left out", what=source),
            )
            return
        is_idle = state.area is None and not self._materials.bounds_media(state.medium, source.place)
        if is_nothing(state.material) and is_idle:
            source.used.update(source.values)
            self._notes.add(
                source.place,
                Sentence(
                    "pbrt-surface-without-material",
                    "A surface without a material, and with no medium on either side, is left out",
                ),
            )
            return
        if source.type in QUADRICS and float(np.linalg.det(state.ctm[0][:3, :3])) < 0:
            self._note_mirrored(source, state)
        alpha = self._textures.number(source, "alpha", 1.0)
        if alpha.is_constant and alpha.value[0] <= 0:
            if state.area is None or self.in_object:
                source.used.update(source.values)
                return
            state, alpha = state._replace(material=None), _UNSEEN  # not intersected, but emits
        if source.type == "curve":
            number = self._materials.number(state.material, self._emission(state, np.zeros(0)), alpha, source.place)
            strand = strand_of(source, self._notes)
            key = number, is_flat(source), state.ctm[0].tobytes(), state.ctm[1].tobytes()
            self._strands.setdefault(key, ([], state.ctm))[0].append(strand)
            return
        radius = whole_sphere(source)
        mesh, areas = self._mesh(source, state, radius)
        spans = self._spans(source, state, mesh)
        number = self._materials.number(state.material, self._emission(state, areas), alpha, source.place, state.medium, spans)
        if radius is not None and not state.reverse and not self._is_textured(number) and self._is_round(state.ctm):
            self._add_part(Part(-1, state.ctm, "sphere", radius, number))
            return
        mapping = self._materials.mappings.get(number)
        shared = (*shape_key(source), number, state.reverse) if source.type in QUADRICS and mapping is None else None
        if shared is not None and shared in self._quadrics:
            self._add_part(Part(self._quadrics[shared], state.ctm, source.type))
            return
        mesh = mesh if mesh is not None else self._quadric(source).mesh
        if source.type == "plymesh":
            number = self._displaced(number, source, state)
        if self._is_textured(number):
            mesh = with_uvs(mesh)
        if mapping is not None:
            mesh = mapped(mesh, mapping, interpolate(state.ctm, self._time))
            if self.in_object:
                self._notes.add(
                    source.place,
                    Sentence(
                        "pbrt-instance-texture-placement",
                        "Textures that are placed in space move with object instances",
                    ),
                )
        self._add_mesh(replace(mesh, material=number), state.ctm)
        if shared is not None:
            self._quadrics[shared] = len(self._description.meshes) - 1

    def _displaced(self, number: int, source: Parameters, state: ShapeState) -> int:
        """Returns the index of the material of a mesh, with the mesh's displacement; `number` if it has none.

        Triangles are as small as ours are by default, whatever the shape's edge length.
        """
        heights = self._textures.number(source, "displacement", 0.0)
        source.get("displacement.edgelength")
        if heights.texture is None or heights.mapping is not None:
            if heights.mapping is not None or heights.value[0] != 0:
                self._notes.add(
                    source.place,
                    Sentence("pbrt-mesh-displacement-ignored", "displacement of meshes that is not by an image is ignored"),
                )
            return number
        scale = -heights.value[0] if state.reverse else heights.value[0]
        return self._materials.displaced(number, heights.texture, scale)

    def _spans(self, source: Parameters, state: ShapeState, mesh: Mesh | None) -> tuple[float, float] | None:
        """Returns the lengths per unit of UV of a shape whose material has a height texture; None without such a texture."""
        heights = self._materials.heights(state.material)
        if heights is None:
            return None
        if self.in_object:
            self._notes.add(
                source.place,
                Sentence(
                    "pbrt-instance-bump-scale", "Bumps of an object that is shown in several sizes are equally steep in each"
                ),
            )
        bumpy = with_uvs(mesh if mesh is not None else self._quadric(source).mesh)
        place = interpolate(state.ctm, self._time)
        if heights.mapping is not None:
            bumpy = mapped(bumpy, heights.mapping, place)
        found = spans_of(bumpy, int(heights.mapping is not None), place[:3, :3])
        return None if found is None else (rounded(found[0]), rounded(found[1]))

    def _note_mirrored(self, source: Parameters, state: ShapeState) -> None:
        """Adds a note if a mirrored quadric emits or is glass: pbrt turns it inside out for rays, but not for light sampling."""
        if state.area is not None or (state.material is not None and state.material.type == "dielectric"):
            self._notes.add(
                source.place,
                Sentence(
                    "pbrt-mirrored-shape-not-inverted",
                    "{source} is mirrored: its inside stays inside, while pbrt turns it inside out",
                    source=source,
                ),
            )

    def flush(self) -> None:
        """Adds the pending curves to the description, as meshes."""
        strands, self._strands = self._strands, {}
        for (number, flat, *_), (found, ctm) in strands.items():
            fibres = flat or self._description.materials[number].kind == "hair"
            self._add_mesh(replace(strands_mesh(found, fibres), material=number, flat=flat), ctm)

    def _mesh(self, source: Parameters, state: ShapeState, radius: float | None) -> tuple[Mesh | None, np.ndarray]:
        """Returns a shape's mesh (None for a complete sphere), and (n,) the areas of the parts that are lights in pbrt."""
        if radius is not None and not state.reverse:
            return None, np.array([4 * np.pi * radius**2])
        if source.type in QUADRICS:
            made = self._quadric(source)
            return flipped(made.mesh) if state.reverse else made.mesh, np.array([made.area])
        mesh = mesh_of(source, self._files, self._notes, self._growth)
        if state.reverse:
            mesh = flipped(mesh)
        if state.area is None:
            return mesh, np.zeros(0)
        placed = mesh.positions.astype(float) @ state.ctm[0][:3, :3].T
        areas = 0.5 * np.linalg.norm(face_normals(placed, mesh.triangles), axis=1)
        return mesh, areas

    def _quadric(self, source: Parameters) -> Quadric:
        """Returns a quadric, cached for equal shapes. In scenes with many quadrics, later ones have fewer segments."""
        key = shape_key(source)
        if key not in self._made:
            coarser = self._growth.coarser()
            if coarser > 1:
                self._notes.add(
                    source.place,
                    Sentence(
                        "pbrt-round-shapes-coarsened", "The scene has very many round shapes; the later ones are drawn coarser"
                    ),
                )
            self._made[key] = quadric(source, coarser)
        return self._made[key]

    def _emission(self, state: ShapeState, areas: np.ndarray) -> Emission:
        if state.area is None:
            return Emission()
        if self.in_object:
            self._notes.add(
                state.area.place,
                Sentence("pbrt-instance-lights-ignored", "Shapes of object instances do not emit, as in pbrt"),
            )
            return Emission()
        return self._lights.surface_emission(state.area, areas)

    def _is_textured(self, number: int) -> bool:
        made = self._description.materials[number]
        return any(name.endswith("_texture") and value is not None for name, value in vars(made).items())

    def _is_round(self, ctm: Ctm) -> bool:
        for each in ctm:
            axes = each[:3, :3]
            square = product(np.ascontiguousarray(axes.T), axes)
            size = square[0, 0]
            if not np.abs(square - size * np.eye(3)).max() <= _ROUND * size:
                return False
        return True

    def _add_mesh(self, mesh: Mesh, ctm: Ctm) -> None:
        self._description.meshes.append(mesh)
        self._add_part(Part(len(self._description.meshes) - 1, ctm, mesh.name))

    def _add_part(self, part: Part) -> None:
        if self._open is not None:
            self._open.append(part)
        else:
            self._add_to_world(part)

    def _make_room(self, triangles: int, place: Place) -> None:
        if len(self._description.instances) + len(self._description.spheres) + triangles > _MOST_INSTANCES:
            raise place.error(
                Sentence(
                    "pbrt-shapes-too-many",
                    "with it more than {most} shapes are shown; reduce them",
                    most=_MOST_INSTANCES,
                )
            )

    def _add_to_world(self, part: Part) -> None:
        """Adds a part to the world, outside of any object."""
        world = product(self._outer, interpolate(part.ctm, self._time))
        self._add_instance(part, world, moves=part.ctm[0] is not part.ctm[1], is_within=False)

    def _add_instance(self, part: Part, world: Matrix, moves: bool, is_within: bool) -> None:
        """Adds a part at a world transform. is_within: whether the part belongs to an instanced object."""
        self._description.moves |= moves
        if part.mesh >= 0:
            self._description.instances.append(Instance(part.mesh, world, name=part.name, moves=moves))
            return
        scale = float(np.sqrt((world[:3, 0] ** 2).sum()))
        if is_within and not self._is_round((world, world)):
            self._ball(part, world, moves)
            return
        x, y, z = (float(v) for v in world[:3, 3])
        self._description.spheres.append(Sphere((x, y, z), part.radius * scale, part.material, part.name, moves=moves))

    def _ball(self, part: Part, world: Matrix, moves: bool) -> None:
        if part.material not in self._balls:
            source = Parameters("shape", "sphere", Place(self._description.name, 0))
            self._description.meshes.append(replace(self._quadric(source).mesh, material=part.material))
            self._balls[part.material] = len(self._description.meshes) - 1
        sized = product(world, np.diag([part.radius, part.radius, part.radius, 1.0]))
        self._description.instances.append(Instance(self._balls[part.material], sized, name=part.name, moves=moves))
