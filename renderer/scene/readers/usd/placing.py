"""Adds the prims of a stage to the description: meshes with materials, shapes, curves, points, lights and cameras."""

from __future__ import annotations

import functools
from collections.abc import Hashable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import UsdGeom, UsdLux, UsdShade

from renderer.errors import SceneError, SettingsError
from renderer.scene.description import Camera, Instance, Mesh, SceneDescription, Sphere
from renderer.scene.files import SceneFiles
from renderer.scene.matrices import Matrix
from renderer.scene.readers.usd import primvars
from renderer.scene.readers.usd.cameras import read_camera, shutter_of
from renderer.scene.readers.usd.curves import spheres_of_points, tubes_of
from renderer.scene.readers.usd.dome import add_dome, is_dome
from renderer.scene.readers.usd.ies import Profiles
from renderer.scene.readers.usd.layers import Stage
from renderer.scene.readers.usd.light_links import LinkSets
from renderer.scene.readers.usd.lights import is_light, mesh_light_fields, note_black_body, read_light_prim
from renderer.scene.readers.usd.meshes import MAX_VERTICES, Shape, UsedPrimvars, area_of, deforms, read_mesh
from renderer.scene.readers.usd.metadata import is_z_up, unit_of
from renderer.scene.readers.usd.notes import UNREADABLE, Notes
from renderer.scene.readers.usd.prims import MAX_INSTANCES, PlacedPrim
from renderer.scene.readers.usd.shapes import is_shape, shape_of
from renderer.scene.readers.usd.skeletons import Skeletons
from renderer.scene.readers.usd.surfaces import Surface, Surfaces
from renderer.scene.readers.usd.textures import Images
from renderer.scene.textures import TextureShelf
from renderer.scene.watertight import is_closed
from renderer.sentences import Sentence

__all__ = ["DescriptionBuilder"]

_SIZELESS = Sentence("usd-shapes-without-size", "Shapes without a size are left out")
MAX_COLORS = 256  # colours of points, one material each


class DescriptionBuilder:
    """Adds the prims of a stage, at one moment, to a scene description.

    source: key of the file and variant, to distinguish them in caches.
    """

    def __init__(
        self,
        files: SceneFiles,
        source: tuple[Hashable, ...],
        stage: Stage,
        description: SceneDescription,
        shelf: TextureShelf,
        images: Images,
        notes: Notes,
        time: Any,
    ) -> None:
        self._files, self._source, self._stage, self._description = files, source, stage.stage, description
        self._shelf, self._images, self._notes, self._time = shelf, images, notes, time
        self._is_still = stage.span is None
        self._unit = unit_of(self._stage, notes)
        self._surfaces = Surfaces(images, shelf, description.materials, notes, time, self._unit)
        self._profiles = Profiles(images, files, notes, time)
        self._skeletons = Skeletons(time, notes)
        self._bound: dict[Any, Any] = {}
        self._numbers: dict[Hashable, list[int]] = {}
        self._vertices = 0

    def add_prims(self, found: list[PlacedPrim]) -> None:
        """Adds all prims to the description; damaged prims are left out with a note."""
        self._bind([each.prim for each in found if each.shown and each.prim.IsA(UsdGeom.Gprim)])
        self._skeletons.gather(found)
        self._links = LinkSets(found, self._description, self._notes)
        for each in found:
            try:
                self._place_one(each)
            except UNREADABLE:
                self._notes.add(
                    Sentence("usd-prims-damaged", "Prims that are damaged or have values of wrong types are left out"),
                    str(each.prim.GetPath()),
                )

    def _place_one(self, each: PlacedPrim) -> None:
        prim = each.prim
        if prim.IsA(UsdGeom.Camera):
            self._camera(each)
        elif not each.shown:
            return
        elif is_dome(prim):
            up = "Z" if is_z_up(self._stage, self._notes) else "Y"
            add_dome(prim, each.places[0], up, self._images, self._shelf, self._description, self._time, self._notes)
        elif is_light(prim):
            self._light(each)
        elif prim.IsA(UsdGeom.Gprim):
            self._gprim(each)
        elif prim.IsA(UsdLux.PluginLight):
            self._notes.add(
                Sentence("usd-light-type-unsupported", "Lights of the type {type} are left out", type=prim.GetTypeName()),
                str(prim.GetPath()),
            )

    def _gprim(self, each: PlacedPrim) -> None:
        prim = each.prim
        if prim.IsA(UsdGeom.Mesh):
            self._mesh(each)
        elif is_shape(prim):
            self._shape(each)
        elif prim.IsA(UsdGeom.BasisCurves):
            self._curves(each)
        elif prim.IsA(UsdGeom.Points):
            self._points(each)
        else:
            self._notes.add(
                Sentence("usd-prim-type-left-out", "Prims of the type {type} are left out", type=prim.GetTypeName()),
                str(prim.GetPath()),
            )

    def _bind(self, prims: list[Any]) -> None:
        """Finds the bound materials of all prims, and of the material subsets of meshes, in one pass."""
        for prim in list(prims):
            if prim.IsA(UsdGeom.Mesh):
                prims += [s.GetPrim() for s in UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets()]
        for purpose in (UsdShade.Tokens.full, UsdShade.Tokens.preview):  # preview only for prims without a full binding
            if prims:
                materials, _ = UsdShade.MaterialBindingAPI.ComputeBoundMaterials(prims, purpose)
                self._bound |= {p.GetPath(): m for p, m in zip(prims, materials, strict=True)}
                prims = [p for p, m in zip(prims, materials, strict=True) if not m]

    def _surface(self, prim: Any, shown_by: Any = None) -> Surface:
        return self._surfaces.surface_of(self._bound.get(prim.GetPath()), prim if shown_by is None else shown_by)

    def _key(self, prim: Any) -> Hashable:
        """Returns a prim's path; for a prim in an instance, that of the prototype's prim, which all instances share."""
        return (prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim).GetPath()

    def _mesh(self, each: PlacedPrim) -> None:
        prim = each.prim
        subsets = [
            s for s in UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets() if s.GetElementTypeAttr().Get() == "face"
        ]
        surfaces = [self._surface(prim), *(self._surface(s.GetPrim(), prim) for s in subsets)]
        if prim.HasAPI(UsdLux.MeshLightAPI):
            surfaces = [self._add_mesh_light_emission(surface, each) for surface in surfaces]
        shape = self._skeletons.shape_of(prim)
        bends = shape is not None or (not self._is_still and deforms(prim))
        if UsdGeom.Mesh(prim).GetSubdivisionSchemeAttr().Get() == "loop" and self._face_sizes(prim).max(initial=3) > 3:
            note = Sentence(
                "usd-loop-subdivision-not-triangles",
                "Loop subdivision surfaces with faces other than triangles are drawn as their cage",
            )
            self._notes.add(note, str(prim.GetPath()))
        key = (self._key(prim), tuple(surfaces), each.prim.GetPath() if shape is not None else None)
        if key not in self._numbers:
            make = functools.partial(self._mesh_parts, prim, surfaces, subsets, shape)
            moment = self._time.GetValue() if bends else None
            known = ("usd mesh", *self._source, self._key(prim), moment, tuple(s[1:] for s in surfaces))
            parts = make() if shape is not None else self._files.get_or_make(known, make)
            shown = [(mesh, s) for mesh, s in zip(parts, surfaces, strict=True) if mesh is not None]
            both = bool(UsdGeom.Gprim(prim).GetDoubleSidedAttr().Get(self._time))
            self._numbers[key] = [self._add(mesh, s, bends, both) for mesh, s in shown]
        moves = each.moves
        if shape is not None:
            each = replace(each, places=self._skeletons.places_of(prim, each.places))
        self._add_instances(self._numbers[key], replace(each, moves=moves))

    def _add_mesh_light_emission(self, surface: Surface, each: PlacedPrim) -> Surface:
        """Returns a mesh's surface with emission added or replaced according to the MeshLightAPI of the prim."""
        place = each.places[0] / np.array([self._unit] * 3 + [1.0])[:, None]
        light, material = UsdLux.LightAPI(each.prim), self._surfaces.material(surface)
        note_black_body(light, self._time, self._description.spectra)
        changes = mesh_light_fields(light, material, area_of(each.prim, place, self._time), self._time)
        for field, name in zip(("light_link", "shadow_link"), self._links.names_for(each.prim), strict=True):
            if name:
                changes[field] = name
        return self._surfaces.with_parameters(surface, f"shining {sorted(changes.items())}", **changes)

    def _face_sizes(self, prim: Any) -> npt.NDArray[np.int64]:
        """Returns (F,) the number of corners of each face of a mesh."""
        return primvars.integers(UsdGeom.Mesh(prim).GetFaceVertexCountsAttr().Get(self._time))

    def _mesh_parts(self, prim: Any, surfaces: list[Surface], subsets: list[Any], shape: Shape | None) -> list[Mesh | None]:
        """Returns the parts of a mesh, one per surface: first the faces in no subset, then each subset."""
        count = len(self._face_sizes(prim))
        of = np.zeros(count, np.int64)
        for number, subset in enumerate(subsets, 1):
            indices = primvars.integers(subset.GetIndicesAttr().Get(self._time))
            inside = indices[(indices >= 0) & (indices < count)]
            free = inside[of[inside] == 0]
            if taken := len(inside) - len(free):
                self._notes.add(
                    Sentence(
                        "usd-subset-faces-overlapping",
                        "{count} faces belong to several subsets; the material of the first subset is used",
                        count=taken,
                    ),
                    str(subset.GetPath()),
                )
            if beyond := len(indices) - len(inside):
                self._notes.add(
                    Sentence(
                        "usd-subset-faces-invalid",
                        "{count} faces of subsets that are missing in their mesh are left out",
                        count=beyond,
                    ),
                    str(subset.GetPath()),
                )
            of[free] = number
        wanted = [UsedPrimvars(s.uvs, s.color, s.opacity) for s in surfaces]
        return read_mesh(prim, wanted, of if subsets else None, self._time, self._notes, shape, not self._is_still)

    def _add(self, mesh: Mesh, surface: Surface, bends: bool = False, both: bool = False) -> int:
        """Adds a mesh with a surface to the description; returns the mesh's index.

        bends: whether the mesh deforms over time. both: whether an emissive mesh emits on both sides.
        """
        material = self._surfaces.material(surface)
        if material.transmission > 0 and not material.thin and not is_closed(mesh.positions, mesh.triangles):
            surface = self._surfaces.with_parameters(surface, "pane", thin=True)
        if both and max(material.emission) > 0:
            surface = self._surfaces.with_parameters(surface, "both", double_sided=True)
        self._vertices += len(mesh.positions)
        if self._vertices > MAX_VERTICES:
            raise SceneError(
                Sentence(
                    "usd-mesh-vertices-too-many",
                    "{name}: its meshes have more than {most} vertices",
                    name=self._description.name,
                    most=MAX_VERTICES,
                )
            )
        self._description.meshes.append(replace(mesh, material=surface.number, deforms=bends))
        return len(self._description.meshes) - 1

    def _add_instances(self, meshes: list[int], each: PlacedPrim) -> None:
        instances = self._description.instances
        if len(instances) + len(each.places) * len(meshes) > MAX_INSTANCES:
            raise SceneError(
                Sentence(
                    "usd-instances-too-many",
                    "{prim}: exceeds the limit of {most} instances; reduce them",
                    prim=each.prim.GetPath(),
                    most=MAX_INSTANCES,
                )
            )
        for i, place in enumerate(each.places):
            name = each.name if len(each.places) == 1 else f"{each.name} [{i}]"
            instances += [Instance(number, place, name=name, moves=each.moves) for number in meshes]

    def _shape(self, each: PlacedPrim) -> None:
        prim = each.prim
        surface = self._surface(prim)
        varies = any(a.ValueMightBeTimeVarying() for a in prim.GetAttributes() if a.GetName() in _SIZES)
        if prim.IsA(UsdGeom.Sphere) and not surface.uvs and len(each.places) == 1 and (size := _scale(each.places[0])):
            radius = float(UsdGeom.Sphere(prim).GetRadiusAttr().Get(self._time) or 0.0) * size
            if radius > 0:
                self._sphere(each, radius, surface.number, each.moves or varies)
            else:
                self._notes.add(_SIZELESS, str(prim.GetPath()))
            return
        sizes = tuple(str(prim.GetAttribute(name).Get(self._time)) for name in _SIZES if prim.HasAttribute(name))
        key = ("shape", str(prim.GetTypeName()), sizes, surface, self._key(prim) if varies else None)
        if key not in self._numbers:
            mesh = self._files.get_or_make(("usd shape", key[1], sizes), lambda: shape_of(prim, self._time))
            if mesh is None:
                self._notes.add(_SIZELESS, str(prim.GetPath()))
            self._numbers[key] = [] if mesh is None else [self._add(mesh, surface, varies)]
        self._add_instances(self._numbers[key], each)

    def _sphere(self, each: PlacedPrim, radius: float, material: int, moves: bool) -> None:
        x, y, z = (float(v) for v in each.places[0][:3, 3])
        self._description.spheres.append(Sphere((x, y, z), radius, material, each.name, moves=moves))

    def _curves(self, each: PlacedPrim) -> None:
        prim = each.prim
        surface = self._surface(prim)
        curves = UsdGeom.BasisCurves(prim)
        varies = any(each.ValueMightBeTimeVarying() for each in (curves.GetPointsAttr(), curves.GetWidthsAttr()))
        key = ("curves", self._key(prim), surface)
        if key not in self._numbers:
            fibres = self._surfaces.material(surface).kind == "hair"
            mesh = tubes_of(prim, self._time, self._notes, surface.color, surface.uvs, fibres, varies)
            self._numbers[key] = [] if mesh is None else [self._add(mesh, surface, varies)]
        self._add_instances(self._numbers[key], each)

    def _points(self, each: PlacedPrim) -> None:
        prim = each.prim
        surface = self._surface(prim)
        balls = spheres_of_points(prim, self._time, self._notes)
        if len(balls.centers) * len(each.places) > MAX_INSTANCES:
            self._notes.add(
                Sentence(
                    "usd-points-too-many",
                    "Points beyond the limit of {most} are left out",
                    most=MAX_INSTANCES,
                ),
                str(prim.GetPath()),
            )
            return
        numbers = np.full(len(balls.centers), surface.number)
        if surface.color is not None and balls.colors is not None:
            numbers = self._materials_by_color(surface, balls.colors, str(prim.GetPath()))
        moves = each.moves or UsdGeom.Points(prim).GetPointsAttr().ValueMightBeTimeVarying()
        for place in each.places:
            size = _scale(place) or float(abs(np.linalg.det(place[:3, :3]))) ** (1 / 3)
            centers = balls.centers.astype(np.float64) @ place[:3, :3].T + place[:3, 3]
            spheres = zip(centers.tolist(), (balls.radii * size).tolist(), numbers.tolist(), strict=True)
            self._description.spheres += [
                Sphere((x, y, z), radius, number, each.name, moves=moves) for (x, y, z), radius, number in spheres if radius > 0
            ]

    def _materials_by_color(self, surface: Surface, colors: npt.NDArray[np.float32], path: str) -> npt.NDArray[np.int64]:
        """Returns (N,) material indices of coloured points, one material per colour.

        With more than MAX_COLORS colours they are quantised, with a note.
        """
        steps = 255
        codes = np.rint(np.clip(colors, 0, 1) * steps).astype(np.int64)
        while len(np.unique(codes @ (1, 256, 65536))) > MAX_COLORS:
            steps //= 2
            codes = np.rint(np.clip(colors, 0, 1) * steps).astype(np.int64)
        if steps < 255:
            self._notes.add(
                Sentence(
                    "usd-point-colours-reduced",
                    "Points of more than {most} colours are drawn in the nearest of {most} colours",
                    most=MAX_COLORS,
                ),
                path,
            )
        kinds, kind = np.unique(codes @ (1, 256, 65536), return_inverse=True)
        numbers = []
        for code in kinds.tolist():
            color = tuple((code >> shift & 255) / steps for shift in (0, 8, 16))
            numbers.append(self._surfaces.with_parameters(surface, f"colour {color}", base_color=color).number)
        found: npt.NDArray[np.int64] = np.array(numbers)[kind]
        return found

    def _camera(self, each: PlacedPrim) -> None:
        prim = each.prim
        try:
            view = read_camera(prim, each.places[0], self._unit, self._time, self._notes)
        except SettingsError as error:
            self._shelf.warn(Sentence("camera-left-out", "Camera {name}: {error}; it is left out.", name=each.name, error=error))
            return
        if not self._description.cameras and self._description.moves:
            shutter = shutter_of(prim, self._time, self._notes)
            if shutter > 0:
                self._description.defaults["shutter"] = shutter
        self._description.cameras.append(Camera(each.name, view))

    def _light(self, each: PlacedPrim) -> None:
        note_black_body(UsdLux.LightAPI(each.prim), self._time, self._description.spectra)
        for i, place in enumerate(each.places):
            name = each.name if len(each.places) == 1 else f"{each.name} [{i}]"
            lamp = read_light_prim(each.prim, place, name, self._unit, self._time, self._notes, self._profiles)
            if lamp is None:
                continue
            light_link, shadow_link = self._links.names_for(each.prim)
            if lamp.light is not None:
                self._description.lights.append(replace(lamp.light, light_link=light_link, shadow_link=shadow_link))
                continue
            assert lamp.material is not None
            lamp.material.light_link, lamp.material.shadow_link = light_link, shadow_link
            if lamp.image is not None and (
                found := self._images.find(lamp.image, Sentence("label-light", "Light {name}", name=name), True, self._time)
            ):
                lamp.material.emission_texture = self._images.texture(found[0], ("clamp", "clamp"), 0, found[1], name)
            one = replace(each, places=place[None], name=name)
            surface = self._surfaces.add(lamp.material)
            if lamp.mesh is None:
                self._sphere(one, lamp.radius, surface.number, each.moves)
            else:
                self._add_instances([self._add(lamp.mesh, surface)], one)


_SIZES = ("radius", "height", "size", "width", "length", "radiusTop", "radiusBottom", "axis")


def _scale(place: Matrix) -> float | None:
    """Returns the uniform scale factor of a transform; None if its scale is not uniform."""
    square = place[:3, :3].T @ place[:3, :3]
    size = float(np.trace(square)) / 3
    return size**0.5 if size > 0 and np.abs(square - size * np.eye(3)).max() < 1e-5 * size else None
