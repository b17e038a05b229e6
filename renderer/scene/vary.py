"""Applies a variation by seed (renderer/variation.py) to a scene description."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from renderer.errors import SettingsError
from renderer.scene.description import Instance, SceneDescription, Sphere
from renderer.scene.material import PARAMETERS, Material
from renderer.scene.matrices import Matrix, product
from renderer.scene.parameters import Parameter
from renderer.sentences import Sentence, first_items
from renderer.settings import Vec3
from renderer.trigonometry import sin_cos
from renderer.variation import Value, Variation

__all__ = ["keeps_surfaces", "varied"]

POWER = "power"  # of a material: factor of its emission
_PARAMETERS = {parameter.in_file: parameter for parameter in PARAMETERS if parameter.form not in ("texture", "name")}
_MOST_NAMES = 12

# Sets an environment, given by name as in `renderer.scene.load.read`, in the description.
LightByName = Callable[[str, SceneDescription], None]


def keeps_surfaces(variation: Variation) -> bool:
    """Returns True if a variation changes no material, in itself or of an object: then `SceneDescription.still` holds."""
    return not variation.materials and not any("material" in values for values in variation.objects.values())


def varied(base: SceneDescription, variation: Variation, number: int, light_by_name: LightByName) -> SceneDescription:
    """Returns the scene with the values of a variation, given by its number. The scene `base` is not changed.

    Raises SettingsError if a name is not in the scene or a value does not fit, and SceneError for an unreadable environment.
    """
    found = replace(
        base,
        instances=list(base.instances),
        spheres=list(base.spheres),
        lights=list(base.lights),
        materials=list(base.materials),
        images=list(base.images),
        warnings=list(base.warnings),
        moves=True,
        variation={},
    )
    _vary_materials(found, variation, number)
    _vary_objects(found, variation, number)
    _vary_lights(found, variation, number)
    _vary_environment(found, variation, number, light_by_name)
    return found


def _vary_objects(found: SceneDescription, variation: Variation, number: int) -> None:
    if not variation.objects:
        return
    names = [each.name or found.meshes[each.mesh].name for each in found.instances]
    values = variation.drawn("objects", [*names, *(sphere.name for sphere in found.spheres)], number)
    found.variation["objects"] = values
    numbers: dict[str, int] = {}
    for n, each in enumerate(found.materials):
        numbers.setdefault(each.name, n)
    members: dict[str, list[int]] = {}
    for n, name in enumerate(names):
        members.setdefault(name, []).append(n)
    for name, of_name in members.items():
        if name not in values:
            continue
        material = _material_number(values[name], numbers, name)
        place = _placement(values[name], found.up, _center([found.instances[n] for n in of_name], found))
        for n in of_name:
            instance = found.instances[n]
            found.instances[n] = replace(
                instance,
                transform=product(place, instance.transform),
                keys=tuple(product(place, key) for key in instance.keys),
                material=instance.material if material is None else material,
                moves=True,
            )
    found.spheres[:] = [
        _varied_sphere(each, values[each.name], numbers) if each.name in values else each for each in found.spheres
    ]


def _varied_sphere(sphere: Sphere, values: dict[str, Value], numbers: dict[str, int]) -> Sphere:
    material = _material_number(values, numbers, sphere.name)
    x, y, z = _triple(values.get("move", 0.0))
    scale = _scale(values)

    def placed(center: Vec3, radius: float) -> tuple[Vec3, float]:
        return (center[0] + x, center[1] + y, center[2] + z), radius * scale

    center, radius = placed(sphere.center, sphere.radius)
    keys = tuple(placed(*key) for key in sphere.keys)
    number = sphere.material if material is None else material
    return replace(sphere, center=center, radius=radius, keys=keys, material=number, moves=True)


def _material_number(values: dict[str, Value], numbers: dict[str, int], name: str) -> int | None:
    if "material" not in values:
        return None
    chosen = str(values["material"])
    if chosen not in numbers:
        raise SettingsError(
            Sentence(
                "vary-material-unknown",
                "vary.objects.{name}.material is {material}; the scene's materials are {materials}",
                name=name[:60],
                material=repr(chosen)[:60],
                materials=first_items((each[:60] for each in numbers), _MOST_NAMES),
            ),
            field="vary",
        )
    return numbers[chosen]


def _scale(values: dict[str, Value]) -> float:
    scale = float(values.get("scale", 1.0))  # type: ignore[arg-type]
    if not 1e-6 <= scale <= 1e6:
        raise _value_error("objects", "scale", scale, "1e-06", "1e+06")
    return scale


def _placement(values: dict[str, Value], up: Vec3, center: Matrix) -> Matrix:
    """Returns the transform (4, 4) of an object's values: scale, tumble and turn about its centre (3,), then move."""
    linear = np.eye(3) * _scale(values)
    if isinstance(tumble := values.get("tumble"), tuple):
        linear = product(_of_quaternion(*tumble), linear)
    if "turn" in values:
        linear = product(_about_axis(up, float(values["turn"])), linear)  # type: ignore[arg-type]
    found = np.eye(4)
    found[:3, :3] = linear
    found[:3, 3] = center - product(linear, center[:, None])[:, 0] + np.array(_triple(values.get("move", 0.0)))
    return found


def _center(instances: list[Instance], description: SceneDescription) -> Matrix:
    """Returns the centre (3,) of the box that holds the boxes of an object's meshes."""
    ends = []
    for instance in instances:
        positions = description.meshes[instance.mesh].positions
        if not len(positions):
            continue
        low, high = positions.min(axis=0).astype(np.float64), positions.max(axis=0).astype(np.float64)
        corners = np.array([np.where(which, high, low) for which in np.ndindex(2, 2, 2)])
        placed = product(instance.transform[:3, :3], corners.T).T + instance.transform[:3, 3]
        ends += [placed.min(axis=0), placed.max(axis=0)]
    if not ends:
        return np.zeros(3)
    found: Matrix = (np.min(ends, axis=0) + np.max(ends, axis=0)) / 2
    return found


def _about_axis(axis: Vec3, degrees: float) -> Matrix:
    """Returns the rotation (3, 3) about an axis, by Rodrigues' formula."""
    length = math.sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2])
    x, y, z = (each / length for each in axis)
    sine, cosine = sin_cos(math.radians(math.fmod(degrees, 360.0)))
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + sine * cross + (1.0 - cosine) * product(cross, cross)


def _of_quaternion(w: float, x: float, y: float, z: float) -> Matrix:
    """Returns the rotation (3, 3) of a unit quaternion."""
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _vary_materials(found: SceneDescription, variation: Variation, number: int) -> None:
    if not variation.materials:
        return
    values = variation.drawn("materials", (material.name for material in found.materials), number)
    found.variation["materials"] = values
    found.materials[:] = [_varied_material(each, values.get(each.name, {})) for each in found.materials]


def _varied_material(material: Material, values: dict[str, Value]) -> Material:
    if not values:
        return material
    kind = str(values.get("kind", material.kind))
    changed: dict[str, Any] = {}
    for name, value in values.items():
        if name == POWER:
            continue
        parameter = _PARAMETERS.get(name)
        if parameter is None or kind not in parameter.kinds:
            known = [each.in_file for each in _PARAMETERS.values() if kind in each.kinds]
            raise SettingsError(
                Sentence(
                    "vary-parameter-unknown",
                    "vary.materials.{material} has {name}; a material of kind {kind} has {names}",
                    material=material.name[:60],
                    name=repr(name)[:60],
                    kind=kind,
                    names=[*known, POWER],
                ),
                field="vary",
            )
        changed[parameter.name] = _parameter_value(material.name, parameter, value)
    if POWER in values:
        color = changed.get("emission", material.emission)
        changed["emission"] = _times(color, _factors("materials", POWER, values[POWER]))
    return replace(material, **changed)


def _parameter_value(material: str, parameter: Parameter, value: Value) -> Any:
    """Returns a drawn value in the form of a material's field. Raises SettingsError if it is outside its range."""
    whole: Any = value
    if parameter.form in ("color", "radiance", "triple") and isinstance(value, float):
        whole = (value, value, value)
    elif parameter.form == "degrees" and isinstance(value, float):
        whole = math.radians(value)
    types = {"number": float, "degrees": float, "flag": bool, "choice": str}
    fault = (
        parameter.fault(whole)
        if isinstance(whole, types.get(parameter.form, tuple))
        else Sentence("vary-value-kind-wrong", "has another kind of value")
    )
    if fault is not None:
        raise SettingsError(
            Sentence(
                "vary-value-invalid",
                "vary.materials.{material}.{name} {fault}",
                material=material[:60],
                name=parameter.in_file,
                fault=fault,
            ),
            field="vary",
        )
    return whole


def _vary_lights(found: SceneDescription, variation: Variation, number: int) -> None:
    if not variation.lights:
        return
    values = variation.drawn("lights", (light.name for light in found.lights), number)
    found.variation["lights"] = values
    for n, light in enumerate(found.lights):
        if (own := values.get(light.name)) is None:
            continue
        x, y, z = _triple(own.get("move", 0.0))
        factors = _times(_factors("lights", "color", own.get("color", 1.0)), _factors("lights", POWER, own.get(POWER, 1.0)))
        keys = []
        for each in (light, *light.keys):
            a, b, c = each.position
            keys.append(replace(each, intensity=_times(each.intensity, factors), position=(a + x, b + y, c + z), keys=()))
        found.lights[n] = replace(keys[0], keys=tuple(keys[1:]))


def _vary_environment(found: SceneDescription, variation: Variation, number: int, light_by_name: LightByName) -> None:
    if not variation.environment:
        return
    values = variation.drawn_environment(number)
    found.variation["environment"] = values
    if "light" in values:
        light_by_name(str(values["light"]), found)
    if found.environment is None:
        raise SettingsError(
            Sentence("vary-environment-missing", "vary.environment: the scene has no environment; name one as light"),
            field="vary",
        )
    changed: dict[str, Any] = {}
    if "color" in values:
        changed["color"] = _times(found.environment.color, _factors("environment", "color", values["color"]))
    if "strength" in values:
        changed["strength"] = _factors("environment", "strength", values["strength"])[0]
    if "rotation" in values:
        changed["rotation"] = values["rotation"]
    found.environment = replace(found.environment, **changed)


def _factors(section: str, name: str, value: Value) -> Vec3:
    """Returns factors of light, three numbers from 0. Raises SettingsError for others."""
    found = _triple(value)
    if not all(0.0 <= each <= 1e9 for each in found):
        raise _value_error(section, name, min(found) if min(found) < 0 else max(found), "0", "1e+09")
    return found


def _value_error(section: str, name: str, value: float, low: str, high: str) -> SettingsError:
    return SettingsError(
        Sentence(
            "vary-value-out-of-range",
            "vary.{section}: {name} is {value}; it must be from {low} to {high}",
            section=section,
            name=name,
            value=f"{value:g}",
            low=low,
            high=high,
        ),
        field="vary",
    )


def _triple(value: Value) -> Vec3:
    """Returns a triple, with a single number repeated."""
    if isinstance(value, tuple):
        return value[0], value[1], value[2]
    return float(value), float(value), float(value)


def _times(a: Vec3, b: Vec3) -> Vec3:
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]
