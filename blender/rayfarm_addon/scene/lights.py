"""Exports Blender's lamps as lights and shapes of a scene file.

In Blender, power is in watts: a point light of power P has the radiant intensity P / (4 pi), a surface of area A the radiance
P / (pi A). A sun's strength is its irradiance. As in Cycles, lamps with a size are visible in reflections, and to the camera
unless hidden from it, and cast no shadows; spots are invisible. A point or spot lamp with "soft falloff" is a disk that faces
the lit point, else a sphere.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from .image_nodes import Painter
from .model import TO_Y_UP, Scene, to_y_up
from .nodes import constant_value, output_of, source_of

__all__ = ["add_light", "bounce_limit", "constant_emission_factor", "is_linked_to_lights", "is_stretched", "kelvins", "lobes_lit"]

F64 = npt.NDArray[np.float64]
MIN_SIZE = 1e-6  # smaller sizes are treated as 0
NEAR = 1e-3
MAX_SPOT_RADIUS = 0.1  # radius from which on a spot has no sharp cone edge
ALL_BOUNCES = 64
MOST_KELVINS = 1e5


def add_light(scene: Scene, thing: Any, name: str, place: F64) -> None:
    """Exports a lamp, an object of type LIGHT. place: its transform."""
    light = thing.data
    strength = _strength(scene, light, name)
    if max(strength) <= 0:
        if light.energy < 0:
            scene.warn(f"Lamp {name}: takes light away in Blender, and is left out.")
        return
    _warn_of_differences(scene, thing, name, place)
    if light.type == "SUN":
        angle = min(float(light.angle), math.pi)
        said = {"type": "directional", "direction": to_y_up(-place[:3, 2]), "intensity": [c * sun_area(light) for c in strength]}
        if angle > MIN_SIZE:
            said["seen"] = "always" if getattr(thing, "visible_camera", True) else "mirrored"
        scene.lights.append({"name": name, **said, "angle": math.degrees(angle), **_temperature(light), **lobes_lit(thing)})
    elif light.type == "AREA":
        _add_area(scene, thing, name, place, strength)
    elif light.type in ("POINT", "SPOT"):
        _add_small(scene, thing, name, place, strength)


def _strength(scene: Scene, light: Any, name: str) -> list[float]:
    color = [float(c) for c in light.color]
    if getattr(light, "use_temperature", False):
        color = [c * float(t) for c, t in zip(color, light.temperature_color, strict=True)]
    energy = float(light.energy) * 2.0 ** float(getattr(light, "exposure", 0.0))
    if light.use_nodes and light.node_tree is not None:
        factor = constant_emission_factor(light.node_tree)
        if factor is None:
            scene.warn(f"Lamp {name}: its nodes are not read; its colour and power are.")
        else:
            color = [c * f for c, f in zip(color, factor, strict=True)]
    return [max(c * energy, 0.0) for c in color]


def kelvins(light: Any) -> float | None:
    """Returns the temperature of a lamp whose colour is that of a black body alone, by its setting or its node; else None."""
    found: list[float] = []
    if getattr(light, "use_temperature", False):
        found.append(float(light.temperature))
    if light.use_nodes and light.node_tree is not None:
        source = output_of(light.node_tree)
        if source is None or source.node.type != "EMISSION":
            return None
        body, last = source_of(source.input("Color"))
        if body is not None and body.node.type == "BLACKBODY":
            found.append(constant_value(body.input("Temperature")))
        elif last is None or len(set(list(last.socket.default_value)[:3])) > 1:
            return None
    is_white = len(set(light.color)) == 1
    return found[0] if is_white and len(found) == 1 and isinstance(found[0], float) and 0 < found[0] <= MOST_KELVINS else None


def _temperature(light: Any) -> dict[str, float]:
    """Returns the field `temperature` of a light; empty if it has none."""
    kelvin = kelvins(light)
    return {} if kelvin is None else {"temperature": kelvin}


def is_linked_to_lights(thing: Any) -> bool:
    """Returns True if an object uses light linking or shadow linking."""
    linking = getattr(thing, "light_linking", None)
    return any(getattr(linking, f"{kind}_collection", None) is not None for kind in ("receiver", "blocker"))


def is_stretched(scale: Any) -> bool:
    """Returns True if a scale differs between the axes X, Y and Z."""
    x, y, z = (abs(float(each)) for each in scale)
    return max(abs(x - z), abs(y - z)) > NEAR * max(x, y, z)


def bounce_limit(light: Any) -> int | None:
    """Returns the bounce limit of a lamp; None if it has none."""
    most = int(getattr(getattr(light, "cycles", None), "max_bounces", ALL_BOUNCES))
    return most if most < ALL_BOUNCES else None


def is_of_a_square_metre(light: Any) -> bool:
    """Returns True if a lamp's power is given per square metre of its area ("Normalize" is off)."""
    return not getattr(light, "normalize", True)


def sun_area(light: Any) -> float:
    """Returns the factor from a sun's strength to its irradiance.

    The factor is 1 if the sun is normalised, else pi sin^2(a) for its half angle a.
    """
    half = min(float(light.angle), math.pi) / 2
    return math.pi * math.sin(half) ** 2 if is_of_a_square_metre(light) and half > MIN_SIZE else 1.0


def _warn_of_differences(scene: Scene, thing: Any, name: str, place: F64) -> None:
    light = thing.data
    casts = getattr(light, "use_shadow", True) and getattr(getattr(light, "cycles", None), "cast_shadow", True)
    if not casts:
        scene.warn(f"Lamp {name}: casts shadows here, though not in Blender.")
    if light.type == "SPOT" and is_stretched(np.linalg.norm(place[:3, :3], axis=0)):
        scene.warn(f"Lamp {name}: its cone is round, and as wide as it says, whatever its scale.")
    if light.type == "SPOT" and light.shadow_soft_size > MAX_SPOT_RADIUS and not getattr(light, "use_soft_falloff", True):
        scene.warn(f"Lamp {name}: its cone is that of a point, though in Blender that of a ball.")
    if (bounces := bounce_limit(light)) is not None:
        scene.warn(f"Lamp {name}: lights however often its light was scattered, though no more than {bounces} times in Blender.")
    if is_linked_to_lights(thing):
        scene.warn(f"Lamp {name}: lights all that it reaches (light linking is left out).")


def lobes_lit(thing: Any) -> dict[str, list[str]]:
    """Returns the field `visible_to` of a lamp as a light: the lobes that it illuminates; empty if all."""
    flags = {kind: "volume_scatter" if kind == "volume" else kind for kind in ("diffuse", "glossy", "transmission", "volume")}
    lit = [kind for kind, flag in flags.items() if getattr(thing, f"visible_{flag}", True)]
    return {"visible_to": lit} if len(lit) < len(flags) else {}


def _seen_by(thing: Any) -> dict[str, list[str]]:
    """Returns the field `visible_to` of a lamp as a shape; empty if only the camera may not see it."""
    lit = lobes_lit(thing)
    camera = ["camera"] if getattr(thing, "visible_camera", True) else []
    return {"visible_to": [*camera, *lit["visible_to"]]} if lit else {}


def constant_emission_factor(tree: Any) -> list[float] | None:
    """Returns the factor by which an Emission node multiplies a lamp's light, (3,); None if it is not constant."""
    source = output_of(tree)
    if source is None or source.node.type != "EMISSION":
        return None
    strength = source.input("Strength")
    falls, _ = source_of(strength)
    if falls is not None and falls.node.type == "LIGHT_FALLOFF":
        if falls.output.name != "Quadratic" or constant_value(falls.input("Smooth")) != 0.0:
            return None
        strength = falls.input("Strength")  # the falloff is quadratic in any case
    made = [Painter("lamp", lambda _: None).paint(at, "light") for at in (source.input("Color"), strength)]
    if not all(isinstance(each, list) for each in made):
        return None
    color, power = made
    return [c * p for c, p in zip(color, power, strict=True)]  # type: ignore[arg-type]


def size_factor(radius: float) -> float:
    """Returns the factor from a point or spot lamp's strength per square metre to its total strength: the area of its sphere."""
    return 4 * math.pi * radius**2


def _add_small(scene: Scene, thing: Any, name: str, place: F64, strength: list[float]) -> None:
    light = thing.data
    radius = float(light.shadow_soft_size)
    is_spot = light.type == "SPOT"
    is_facing = bool(getattr(light, "use_soft_falloff", False))
    if is_of_a_square_metre(light) and radius > MIN_SIZE:
        strength = [c * size_factor(radius) for c in strength]
    if not is_spot and radius > MIN_SIZE:
        radiance = [c / (4 * math.pi**2 * radius**2) for c in strength]
        scene.lamp_materials[name] = _emissive_material(thing, radiance) | ({"facing": True} if is_facing else {})
        ball = {"center": to_y_up(place[:3, 3]), "radius": radius}
        scene.lamps.append({"type": "sphere", "name": name, "material": name, **ball, **_seen_by(thing)})
        return
    said: dict[str, Any] = {"type": "spot" if is_spot else "point", "name": name, "position": to_y_up(place[:3, 3])}
    said |= {"intensity": [c / (4 * math.pi) for c in strength], "radius": radius if radius > MIN_SIZE else 0}
    if is_facing and radius > MIN_SIZE:
        said["facing"] = True
    if is_spot:
        half = float(light.spot_size) / 2
        dark = math.cos(half)
        full = dark + (1 - dark) * float(light.spot_blend)
        said |= {"direction": to_y_up(-place[:3, 2]), "outer_cone": min(math.degrees(half), 180.0), "falloff": "smooth"}
        said |= {"inner_cone": min(math.degrees(math.acos(min(max(full, -1.0), 1.0))), said["outer_cone"])}
    scene.lights.append(said | _temperature(light) | lobes_lit(thing))


def _emissive_material(thing: Any, radiance: list[float]) -> dict[str, Any]:
    """Returns the emissive material, as glTF JSON, of a lamp that is exported as a surface."""
    said: dict[str, Any] = {"color": 0, "emission": radiance, "lamp": True}
    if (kelvin := kelvins(thing.data)) is not None:
        said["emission_temperature"] = kelvin
    return said if getattr(thing, "visible_camera", True) else {**said, "unseen": True}


def _add_area(scene: Scene, thing: Any, name: str, place: F64, strength: list[float]) -> None:
    light = thing.data
    if getattr(getattr(light, "cycles", None), "is_portal", False):
        return  # a portal, which guides Cycles' sampling and emits nothing
    if getattr(light, "spread", math.pi) < math.pi - 1e-3:
        scene.warn(f"Lamp {name}: its spread is left out; it shines to all sides before it.")
    width = float(light.size)
    height = float(light.size_y) if light.shape in ("RECTANGLE", "ELLIPSE") else width
    is_round = light.shape in ("DISK", "ELLIPSE")
    # The farm's quad is -1..1 and faces +Z; a lamp shines along its -Z.
    turned = place @ np.diag([width / 2, height / 2, 1.0, 1.0]) @ np.diag([1.0, -1.0, -1.0, 1.0])
    sides = turned[:3, :2]
    area = float(np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]))) * (math.pi if is_round else 4.0)
    if area < MIN_SIZE**2:
        return
    if is_of_a_square_metre(light):
        strength = [c * area for c in strength]
    scene.lamp_materials[name] = _emissive_material(thing, [c / (math.pi * area) for c in strength])
    matrix = (TO_Y_UP @ turned).tolist()
    kind = "disk" if is_round else "quad"
    scene.lamps.append({"type": kind, "name": name, "material": name, "transform": [{"matrix": matrix}], **_seen_by(thing)})
