"""UsdLux lights: area lights become emissive surfaces, others point, spot and directional lights. Source: UsdLux's schema."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from pxr import UsdLux

from renderer.scene.description import Light, Mesh, Vec3
from renderer.scene.given_spectra import GivenSpectrum, black_body
from renderer.scene.material import Material
from renderer.scene.matrices import Matrix
from renderer.scene.readers.number_ranges import blended_cone
from renderer.scene.readers.shapes import disk, lathe, quad
from renderer.scene.readers.usd.ies import Profiles
from renderer.scene.readers.usd.notes import Notes
from renderer.scene.readers.usd.written_by_blender import is_written_by_blender
from renderer.sentences import Sentence

__all__ = ["Lamp", "is_light", "mesh_light_fields", "note_black_body", "radiance_of", "read_light_prim"]

_MOST = 1e9
# Blender writes a quarter of a sun's strength and half of its angle, and its own importer reverts that.
_BLENDERS_SUN, _BLENDERS_ANGLE = 4.0, 2.0
_TURN = np.diag([-1.0, 1.0, -1.0])  # from our shapes, which face +Z, to lights, which emit along -Z; keeps the texture upright


class Lamp(NamedTuple):
    """A light converted from USD: a `light` without a surface, or else an emissive surface.

    The surface is `mesh`, or a sphere with `radius` in metres.
    """

    light: Light | None = None
    mesh: Mesh | None = None
    radius: float = 0.0
    material: Material | None = None
    image: Any = None  # attribute with the texture's file


def is_light(prim: Any) -> bool:
    """Returns True if a prim is a light of a standard UsdLux type."""
    return bool(prim.IsA(UsdLux.BoundableLightBase) or prim.IsA(UsdLux.NonboundableLightBase))


def radiance_of(light: Any, time: Any, size: float = 1.0) -> Vec3:
    """Returns the RGB radiance of a light from its intensity, exposure, colour and temperature.

    size: the light's area or solid angle; divides the radiance if the light is normalised.
    """

    scale = _number(light.GetIntensityAttr(), time, 1.0) * 2.0 ** min(_number(light.GetExposureAttr(), time), 60.0)
    color = _color(light, time)
    if (kelvin := _kelvin(light, time)) is not None:
        color = color * np.array(UsdLux.BlackbodyTemperatureAsRgb(kelvin), np.float64)
    if light.GetNormalizeAttr().Get(time) and size > 0:
        scale /= size
    r, g, b = (float(c) for c in np.nan_to_num(np.clip(color * scale, 0.0, _MOST)))
    return r, g, b


def _color(light: Any, time: Any) -> npt.NDArray[np.float64]:
    return np.array(light.GetColorAttr().Get(time) or (1.0, 1.0, 1.0), np.float64)


def _kelvin(light: Any, time: Any) -> float | None:
    """Returns a light's temperature in kelvins; None if it has none.

    Without an authored temperature the colour is the white point; Blender writes that for all lights.
    """
    if light.GetEnableColorTemperatureAttr().Get(time) and light.GetColorTemperatureAttr().HasAuthoredValue():
        return min(max(_number(light.GetColorTemperatureAttr(), time, 6500.0), 1000.0), 10000.0)
    return None


def note_black_body(light: Any, time: Any, spectra: list[GivenSpectrum]) -> None:
    """Adds the spectrum of a light with a temperature to `spectra`, unless the light has a colour besides."""
    kelvin = _kelvin(light, time)
    if kelvin is not None and np.ptp(_color(light, time)) == 0:
        red, green, blue = UsdLux.BlackbodyTemperatureAsRgb(kelvin)
        spectra.append(black_body((red, green, blue), kelvin))


def mesh_light_fields(light: Any, material: Material, area: float, time: Any) -> dict[str, Any]:
    """Returns the material fields to change for a mesh with MeshLightAPI. area: the mesh's area in square stage units.

    The light's materialSyncMode decides how the bound material contributes: it is replaced, its emission is added to the light's
    (`independent`), or its emission multiplies the light's.
    """
    radiance = radiance_of(light, time, area)
    said = light.GetMaterialSyncModeAttr().Get(time)
    if said == "noMaterialResponse":
        return {"base_color": (0.0, 0.0, 0.0), "base_color_texture": None, "emission": radiance, "emission_texture": None}
    if max(material.emission) == 0:
        return {"emission": radiance}
    (r, g, b), (x, y, z) = radiance, material.emission
    return {"emission": (r + x, g + y, b + z) if said == "independent" else (r * x, g * y, b * z)}


def read_light_prim(
    prim: Any, world: Matrix, name: str, unit: float, time: Any, notes: Notes, profiles: Profiles | None = None
) -> Lamp | None:
    """Returns a light in world space; None, with a note, if its kind is not supported.

    world: (4, 4) transform to metres; unit: metres per stage unit, used for the areas that normalise lights. In Blender's files
    these areas are in square metres whatever the stage's unit. profiles: reads the IES profiles; None ignores them.
    All rays pass through the surface of a light that is invisible to the camera, as in Cycles.
    """
    unit = 1.0 if is_written_by_blender(prim) else unit
    found = None
    if profiles is not None and (file := profiles.profile_attribute(prim)) is not None:
        found = _with_profile(prim, world, name, unit, time, notes, profiles, file)
    if found is None:
        found = _lamp(prim, world, name, unit, time, notes)
    if found is not None and found.material is not None:
        found.material.lamp = found.material.unseen = _is_unseen(prim, time)
    spot = found.light if found is not None and found.light is not None and found.light.kind == "spot" else None
    if spot is not None and is_written_by_blender(prim):  # Blender's softness is a blend in the cosine
        spot.inner_cone, spot.falloff = blended_cone(spot.outer_cone, 1 - spot.inner_cone / spot.outer_cone), "smooth"
    return found


def _is_unseen(prim: Any, time: Any) -> bool:
    """Returns True if a light is invisible to camera rays.

    By default UsdLux lights are visible and those written by Blender are not; the visibleInPrimaryRay attributes of the Cycles
    and Omniverse delegates override this.
    """
    told = prim.GetAttribute("inputs:visibleInPrimaryRay") or prim.GetAttribute("visibleInPrimaryRay")
    value = told.Get(time) if told else None
    return is_written_by_blender(prim) if value is None else not value


def _lamp(prim: Any, world: Matrix, name: str, unit: float, time: Any, notes: Notes) -> Lamp | None:
    light = UsdLux.LightAPI(prim)
    _note_unsupported(light, prim, time, notes)
    place = (float(world[0, 3]), float(world[1, 3]), float(world[2, 3]))
    forward = _direction(-world[:3, 2])
    if prim.IsA(UsdLux.DistantLight):
        angle = min(max(_number(UsdLux.DistantLight(prim).GetAngleAttr(), time), 0.0), 180.0)
        cone = math.pi * math.sin(math.radians(angle / 2)) ** 2
        irradiance = radiance_of(light, time, cone) if cone > 0 else radiance_of(light, time)
        scale, wider = (_BLENDERS_SUN, _BLENDERS_ANGLE) if is_written_by_blender(prim) else (1.0, 1.0)
        r, g, b = (c * (cone or 1.0) * scale for c in irradiance)
        return Lamp(Light("directional", (r, g, b), direction=forward, angle=min(angle * wider, 180.0), name=name))
    lengths = np.linalg.norm(world[:3, :3], axis=0) / unit
    x, y, z = (float(length) for length in lengths)
    if prim.IsA(UsdLux.SphereLight):
        sphere = UsdLux.SphereLight(prim)
        size = (
            1.0 if is_written_by_blender(prim) else (x * y * z) ** (1 / 3)
        )  # Blender's lights are not enlarged by the scale of their parents
        radius = _number(sphere.GetRadiusAttr(), time) * size
        area = 4 * math.pi * (radius or 1.0) ** 2
        found = _cone(prim, time, notes, True)
        if sphere.GetTreatAsPointAttr().Get(time) or radius <= 0:
            # The sphere's power. Without a radius, that of radius 1: after normalisation the power does not depend on the radius.
            rgb = _times(radiance_of(light, time, area), math.pi * (radius or 1.0) ** 2)
            return Lamp(_with_cone(Light("point", rgb, place, forward, 0.0, name=name), found, unit))
        if found is None:
            return Lamp(radius=radius * unit, material=_emissive_material(name, radiance_of(light, time, area)))
        rgb = _times(radiance_of(light, time, area), math.pi * radius**2)
        return Lamp(_with_cone(Light("point", rgb, place, forward, radius * unit, name=name), found, unit))
    if prim.IsA(UsdLux.RectLight):
        rect = UsdLux.RectLight(prim)
        width, height = _number(rect.GetWidthAttr(), time), _number(rect.GetHeightAttr(), time)
        _cone(prim, time, notes, False)
        shape = _place_mesh(quad(name), _TURN, width / 2, height / 2)
        return _emissive_mesh(shape, light, time, width * x * height * y, name, notes, rect.GetTextureFileAttr())
    if prim.IsA(UsdLux.DiskLight):
        radius = _number(UsdLux.DiskLight(prim).GetRadiusAttr(), time)
        area = math.pi * radius**2 * x * y
        aimed = _cone(prim, time, notes, True)
        if aimed is not None:
            rgb = _times(radiance_of(light, time, area), area)
            return Lamp(_with_cone(Light("point", rgb, place, forward, radius * math.sqrt(x * y) * unit, name=name), aimed, unit))
        return _emissive_mesh(_place_mesh(disk(name), _TURN, radius, radius), light, time, area, name, notes)
    if prim.IsA(UsdLux.CylinderLight):
        cylinder = UsdLux.CylinderLight(prim)
        radius, length = _number(cylinder.GetRadiusAttr(), time), _number(cylinder.GetLengthAttr(), time)
        _cone(prim, time, notes, False)
        if cylinder.GetTreatAsLineAttr().Get(time):
            notes.add(Sentence("usd-line-lights-replaced", "Line lights are rendered with their full shape"), name)
        area = 2 * math.pi * radius * length * x * math.sqrt(y * z)
        tube = lathe(name, [(radius, -length / 2), (radius, length / 2)], 48)
        tube.positions, tube.normals = (None if v is None else v[:, [1, 2, 0]] for v in (tube.positions, tube.normals))  # type: ignore[assignment]
        return _emissive_mesh(tube, light, time, area, name, notes)
    notes.add(
        Sentence("usd-light-type-unsupported", "Lights of the type {type} are left out", type=prim.GetTypeName()),
        str(prim.GetPath()),
    )
    return None


def _with_profile(
    prim: Any, world: Matrix, name: str, unit: float, time: Any, notes: Notes, profiles: Profiles, file: Any
) -> Lamp | None:
    """Returns a light with an IES profile, emitted from its centre: a sphere light, or a disk or rectangle with cosine falloff.

    Returns None if the profile is missing or the light has another shape.
    """
    light = UsdLux.LightAPI(prim)
    lengths = np.linalg.norm(world[:3, :3], axis=0) / unit
    x, y, z = (float(length) for length in lengths)
    is_flat = True
    if prim.IsA(UsdLux.SphereLight):
        sphere, is_flat = UsdLux.SphereLight(prim), False
        own = _number(sphere.GetRadiusAttr(), time) * (x * y * z) ** (1 / 3)
        radius = 0.0 if sphere.GetTreatAsPointAttr().Get(time) else max(own, 0.0)
        facing, whole = math.pi * (own or 1.0) ** 2, 4 * math.pi * (own or 1.0) ** 2
    elif prim.IsA(UsdLux.DiskLight):
        whole = facing = math.pi * _number(UsdLux.DiskLight(prim).GetRadiusAttr(), time) ** 2 * x * y
        radius = math.sqrt(facing / math.pi)
    elif prim.IsA(UsdLux.RectLight):
        rect = UsdLux.RectLight(prim)
        whole = facing = _number(rect.GetWidthAttr(), time) * x * _number(rect.GetHeightAttr(), time) * y
        radius = math.sqrt(max(facing, 0.0) / math.pi)
        if (picture := rect.GetTextureFileAttr().Get(time)) is not None and picture.path:
            notes.add(Sentence("usd-light-texture-with-ies", "Textures of lights with an IES profile are left out"), name)
    else:
        notes.add(
            Sentence("usd-light-shape-with-ies", "IES profiles are left out of lights that are not spheres, disks or rectangles"),
            name,
        )
        return None
    emission = profiles.emission(prim, file, is_flat)
    if emission is None:
        return None
    if is_flat and radius > 0:
        notes.add(
            Sentence(
                "usd-area-light-with-ies",
                "Disk and rectangle lights with an IES profile are replaced by invisible spheres of their size",
            ),
            name,
        )
    _note_unsupported(light, prim, time, notes)
    place = (float(world[0, 3]), float(world[1, 3]), float(world[2, 3]))
    rgb = _times(radiance_of(light, time, whole), facing)
    found = Light("point", rgb, place, _direction(-world[:3, 2]), radius * unit, name=name)
    found.emission, found.up = emission, _direction(-world[:3, 1])
    return Lamp(_with_cone(found, _cone(prim, time, notes, True), unit))


def _number(attribute: Any, time: Any, default: float = 0.0) -> float:
    """Returns the number in an attribute at a time; the default if the value is missing or not finite."""
    value = attribute.Get(time)
    return default if value is None or not math.isfinite(value) else float(value)


def _emissive_mesh(mesh: Mesh, light: Any, time: Any, area: float, name: str, notes: Notes, image: Any = None) -> Lamp | None:
    if area <= 0:
        notes.add(Sentence("usd-light-without-area", "Lights without an area are left out"), name)
        return None
    return Lamp(mesh=mesh, material=_emissive_material(name, radiance_of(light, time, area)), image=image)


def _emissive_material(name: str, radiance: Vec3) -> Material:
    return Material(name, base_color=(0.0, 0.0, 0.0), emission=radiance)


def _place_mesh(mesh: Mesh, rotation: Matrix, width: float, height: float) -> Mesh:
    matrix = rotation @ np.diag([width, height, 1.0])
    mesh.positions = (mesh.positions @ matrix.T).astype(np.float32)
    if mesh.normals is not None:
        mesh.normals = (mesh.normals @ rotation.T).astype(np.float32)
    return mesh


def _direction(v: Any) -> Vec3:
    length = float(np.linalg.norm(v))
    return (float(v[0] / length), float(v[1] / length), float(v[2] / length)) if length > 0 else (0.0, -1.0, 0.0)


def _times(rgb: Vec3, factor: float) -> Vec3:
    return rgb[0] * factor, rgb[1] * factor, rgb[2] * factor


def _with_cone(light: Light, cone: tuple[float, float] | None, unit: float) -> Light:
    """Returns a light with its intensity converted from stage units to metres (times unit^2); with a cone, it becomes a spot.

    cone: (inner, outer) half angles in degrees, or None.
    """
    light.intensity = _times(light.intensity, unit * unit)
    if cone is not None:
        light.kind, light.falloff, (light.inner_cone, light.outer_cone) = "spot", "smooth angle", cone
    return light


def _cone(prim: Any, time: Any, notes: Notes, is_known: bool) -> tuple[float, float] | None:
    """Returns the (inner, outer) half angles of a light's cone, in degrees; None for a light without a cone.

    is_known: whether cones are supported for this kind of light; if not, a note is added.
    """
    if not prim.HasAPI(UsdLux.ShapingAPI):
        return None
    shaping = UsdLux.ShapingAPI(prim)
    name = str(prim.GetPath())
    if (shaping.GetShapingFocusAttr().Get(time) or 0.0) != 0:
        notes.add(Sentence("usd-light-focus-ignored", "The focus of lights is left out"), name)
    angle = min(max(_number(shaping.GetShapingConeAngleAttr(), time, 90.0), 0.01), 180.0)
    if not shaping.GetShapingConeAngleAttr().HasAuthoredValue() or angle >= 180:
        return None
    if not is_known:
        notes.add(
            Sentence("usd-light-cone-ignored", "The cones of rectangular and cylindrical lights are left out"),
            name,
        )
        return None
    soft = min(max(_number(shaping.GetShapingConeSoftnessAttr(), time), 0.0), 1.0)
    return angle * (1 - soft), angle


def _note_unsupported(light: Any, prim: Any, time: Any, notes: Notes) -> None:
    name = str(prim.GetPath())
    for attribute in (light.GetDiffuseAttr(), light.GetSpecularAttr()):
        if attribute.Get(time) not in (None, 1.0):
            notes.add(
                Sentence(
                    "usd-light-multipliers-ignored",
                    "Diffuse and specular multipliers of lights are ignored",
                ),
                name,
            )
    shadow = UsdLux.ShadowAPI(prim) if prim.HasAPI(UsdLux.ShadowAPI) else None
    if shadow and shadow.GetShadowEnableAttr().Get(time) is False:
        notes.add(Sentence("usd-light-shadows-forced", "Lights without shadows cast shadows here"), name)
    if shadow and (any(shadow.GetShadowColorAttr().Get(time) or ()) or (shadow.GetShadowDistanceAttr().Get(time) or -1.0) > 0):
        notes.add(
            Sentence("usd-light-shadow-options-ignored", "Shadow colour, distance and falloff of lights are ignored"),
            name,
        )
    if light.GetFiltersRel().HasAuthoredTargets():
        notes.add(Sentence("usd-light-filters-ignored", "Filters of lights are left out"), name)
