"""Converts lights to Rayfarm's scene format: from watts to radiant intensity, irradiance and radiance, as in Cycles."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any

from .cameras import to_ours
from .keys import keyed
from .light_groups import light_group_of
from .light_links import LinkSets
from .light_profiles import EmissionImage, is_animated_light, needs_emission_image, render_emission_image
from .ray_visibility import KINDS
from .sentences import Sentence

__all__ = ["Lights"]

AREA = 1 / math.pi  # radiance of an area light of one watt and one square metre
MAX_INTENSITY = 1e9
MAX_POINT_RADIUS = 0.1  # scene units: larger points are spheres, whose spot cone has no single edge
MIN_RADIUS = 1e-4  # the least radius of a point light
MOST_PICTURES = 64  # of emission images: each takes a second or two
LOBES = ("diffuse", "glossy", "transmission", "volume")


class Lights:
    """Converts the scene's lights.

    Suns, spots, and points without a size or with nodes that shape their emission, become lights; all others become emitting
    shapes that cast no shadows.
    """

    def __init__(self, bpy: Any, scene: Any, addon_lights: Any, notes: list[str], out: Path) -> None:
        """Initialises the conversion of a scene's lights.

        addon_lights: the add-on's module of lights; None if not available. out: folder for the emission images.
        """
        import mathutils

        self._bpy, self._math, self._known = bpy, mathutils, addon_lights
        lights = [thing for thing in scene.objects if thing.type == "LIGHT" and not thing.hide_render]
        self._all = sorted((thing for thing in lights if not _is_portal(thing.data)), key=lambda thing: thing.name)
        self._turns: dict[str, Any] = {}
        self._thrown: dict[str, EmissionImage] = {}
        self._render_emission_images(out)
        for thing in lights:
            self._note_limits(thing, notes)

    def _render_emission_images(self, out: Path) -> None:
        """Renders the emission images, one for each light data block."""
        taken: dict[str, EmissionImage] = {}
        for thing in self._all:
            data = thing.data
            is_odd = (
                self._known is not None
                and data.use_nodes
                and data.node_tree is not None
                and self._node_color_factor(data) is None
            )
            if is_odd and needs_emission_image(self._bpy, data):
                if data.name not in taken and len(taken) == MOST_PICTURES:
                    continue
                if data.name not in taken:
                    taken[data.name] = render_emission_image(self._bpy, thing, out, f"blender-lamp-{len(taken)}.exr")
                self._thrown[thing.name] = taken[data.name]

    def state_functions(self) -> dict[str, Any]:
        """Returns light name -> function that returns the light's current state."""
        return {thing.name: partial(self._current_state, thing) for thing in self._all}

    def scene_file_lights(
        self, states: dict[str, list[dict[str, Any]]], frames: list[int], fps: float, links: LinkSets
    ) -> tuple[list[Any], dict[str, Any], list[Any]]:
        """Returns the lights, materials and shapes of the scene file.

        states: light name -> its states at the frames. links: receives the link sets of the lights.
        """
        lights, materials, shapes = [], {}, []
        for thing in self._all:
            values = states[thing.name]
            said: dict[str, Any] = {name: keyed([each[name] for each in values], frames, fps) for name in values[0]}
            name = thing.name[:200]
            group = {"light_group": light_group_of(thing)} if light_group_of(thing) else {}
            group |= links.fields_for(thing)
            lobes = [kind for kind in LOBES if getattr(thing, KINDS[kind], True)]
            visible = {"visible_to": lobes} if len(lobes) < len(LOBES) else {}
            kelvin = self._known.kelvins(thing.data) if self._known is not None else None
            if "emission" not in said:
                warm = {} if kelvin is None else {"temperature": kelvin}
                lights.append({"name": name, **_kind(thing, self._thrown.get(thing.name)), **said, **warm, **group, **visible})
                continue
            material = f"light {name}"
            materials[material] = {"color": 0, "emission": said["emission"], "lamp": True, **group}
            if kelvin is not None:
                materials[material]["emission_temperature"] = kelvin
            if not getattr(thing, "visible_camera", True):
                materials[material]["unseen"] = True
            elif visible:
                visible["visible_to"] = ["camera", *lobes]
            if getattr(thing.data, "use_soft_falloff", False) and "center" in said:
                materials[material]["facing"] = True
            if "center" in said:
                ball = {name: said[name] for name in ("center", "radius")}
                shapes.append({"type": "sphere", "name": name, "material": material, **ball, **visible})
                continue
            x, y, z = (
                said["turn"]
                if isinstance(said["turn"], list)
                else ({"keys": [[t, v[i]] for t, v in said["turn"]["keys"]]} for i in range(3))
            )
            turns = [{"rotate": {"axis": axis, "degrees": degrees}} for axis, degrees in (("x", x), ("y", y), ("z", z))]
            kind = "disk" if thing.data.shape in ("DISK", "ELLIPSE") else "quad"
            transform = [{"scale": said["size"]}, *turns, {"translate": said["place"]}]
            shapes.append({"type": kind, "name": name, "material": material, "transform": transform, **visible})
        return lights, materials, shapes

    def _current_state(self, thing: Any) -> dict[str, Any]:
        graph = self._bpy.context.evaluated_depsgraph_get()
        lamp = thing.evaluated_get(graph)
        data, world = lamp.data, lamp.matrix_world
        watts = [min(c * max(data.energy, 0.0) * _size_factor(data, world.to_scale()), MAX_INTENSITY) for c in self._color(data)]
        forward = to_ours((world.to_3x3() @ self._math.Vector((0, 0, -1))).normalized())
        if data.type == "SUN":
            return {"intensity": watts, "direction": forward, "angle": min(math.degrees(data.angle), 180.0)}
        scale = world.to_scale()
        if data.type == "AREA":
            return self._area(thing.name, data, world, scale, watts)
        radius = data.shadow_soft_size
        thrown = self._thrown.get(thing.name)
        if data.type == "POINT" and thing.data.shadow_soft_size > MIN_RADIUS and thrown is None:
            radius = max(radius, MIN_RADIUS)
            radiance = [min(c / (4 * math.pi**2 * radius**2), MAX_INTENSITY) for c in watts]
            return {"emission": radiance, "center": to_ours(world.translation), "radius": radius}
        found = {"intensity": [c / (4 * math.pi) for c in watts], "position": to_ours(world.translation), "radius": radius}
        if thrown is not None:
            found |= {"direction": forward, "up": to_ours((world.to_3x3() @ self._math.Vector((0, 1, 0))).normalized())}
        if data.type == "SPOT" and (thrown is None or thrown.is_window):
            outer = min(data.spot_size / 2, math.radians(89.9))
            edge = math.cos(outer)
            inner = math.acos(min(edge + (1 - edge) * data.spot_blend, 1.0))
            found |= {
                "direction": forward,
                "outer_cone": math.degrees(outer),
                "inner_cone": min(math.degrees(inner), math.degrees(outer)),
            }
        return found

    def _area(self, name: str, data: Any, world: Any, scale: Any, watts: list[float]) -> dict[str, Any]:
        has_two = data.shape in ("RECTANGLE", "ELLIPSE")
        width, height = data.size * abs(scale.x), (data.size_y if has_two else data.size) * abs(scale.y)
        area = max(width * height * (math.pi / 4 if data.shape in ("DISK", "ELLIPSE") else 1.0), 1e-12)
        ours = self._math.Matrix(((1, 0, 0), (0, 0, 1), (0, -1, 0)))
        half_turn = self._math.Matrix(((-1, 0, 0), (0, 1, 0), (0, 0, -1)))  # Blender's lights point along -Z, ours along +Z
        turn = (ours @ world.to_quaternion().to_matrix() @ half_turn).to_euler("XYZ")
        if name in self._turns:
            turn.make_compatible(self._turns[name])
        self._turns[name] = turn
        return {
            "emission": [min(c * AREA / area, MAX_INTENSITY) for c in watts],
            "size": [width / 2, height / 2, 1.0],
            "turn": [math.degrees(a) for a in turn],
            "place": to_ours(world.translation),
        }

    def _color(self, data: Any) -> list[float]:
        """Returns the factor, rgb, from a light's power in watts to its coloured power.

        The factor includes colour, temperature, exposure, and nodes if they are constant.
        """
        color = list(data.color)
        if getattr(data, "use_temperature", False):
            color = [a * b for a, b in zip(color, data.temperature_color, strict=True)]
        if (factor := self._node_color_factor(data)) is not None:
            color = [a * b for a, b in zip(color, factor, strict=True)]
        scale = 2.0 ** getattr(data, "exposure", 0.0)
        return [max(c * scale, 0.0) for c in color]

    def _node_color_factor(self, data: Any) -> list[float] | None:
        has_some = data.use_nodes and data.node_tree is not None and self._known is not None
        return self._known.constant_emission_factor(data.node_tree) if has_some else None

    def _note_limits(self, thing: Any, notes: list[str]) -> None:
        data = thing.data
        if thing.name in self._thrown:
            if data.type == "POINT" and data.shadow_soft_size > MIN_RADIUS:
                notes.append(
                    Sentence(
                        "blend-light-not-in-mirrors",
                        "Light {light}: not visible in mirrors, since its nodes emit differently in each direction",
                        light=thing.name,
                    )
                )
            if is_animated_light(data):
                notes.append(
                    Sentence(
                        "blend-light-animated-nodes",
                        "Light {light}: its animated nodes are evaluated at the first frame",
                        light=thing.name,
                    )
                )
        elif data.use_nodes and data.node_tree is not None and self._node_color_factor(data) is None:
            notes.append(
                Sentence(
                    "blend-light-nodes", "Light {light}: its nodes are ignored; it has its own colour and power", light=thing.name
                )
            )
        if data.type == "SPOT" and data.shadow_soft_size > MAX_POINT_RADIUS and not getattr(data, "use_soft_falloff", True):
            notes.append(
                Sentence(
                    "blend-light-cone-of-point",
                    "Light {light}: its cone is that of a point, not of a sphere as in Blender",
                    light=thing.name,
                )
            )
        if data.energy < 0:
            notes.append(Sentence("blend-light-negative", "Light {light}: its negative power is set to 0", light=thing.name))
        if data.type == "AREA" and data.spread < math.pi - 1e-3:
            notes.append(
                Sentence(
                    "blend-light-spread", "Light {light}: its spread is ignored; it emits in all directions", light=thing.name
                )
            )
        if self._known is not None and data.type == "SPOT" and self._known.is_stretched(thing.matrix_world.to_scale()):
            notes.append(
                Sentence(
                    "blend-light-cone-scale",
                    "Light {light}: its cone is circular and has its nominal angle, whatever its scale",
                    light=thing.name,
                )
            )
        if self._known is not None and (most := self._known.bounce_limit(data)) is not None:
            notes.append(
                Sentence(
                    "blend-light-bounces",
                    "Light {light}: lights after any number of bounces, not at most {limit} as in Blender",
                    light=thing.name,
                    limit=most,
                )
            )
        if not getattr(data, "use_shadow", True):
            notes.append(Sentence("blend-light-shadows", "Light {light}: casts shadows, unlike in Blender", light=thing.name))


def _is_portal(data: Any) -> bool:
    """Returns True if a light is a portal, which guides Cycles' sampling and emits nothing."""
    return data.type == "AREA" and bool(getattr(getattr(data, "cycles", None), "is_portal", False))


def _kind(thing: Any, thrown: EmissionImage | None) -> dict[str, Any]:
    data = thing.data
    if data.type == "SUN":
        seen = {"seen": "always" if getattr(thing, "visible_camera", True) else "mirrored"} if data.angle > 0 else {}
        return {"type": "directional", **seen}
    facing = {"facing": True} if getattr(data, "use_soft_falloff", False) else {}
    if thrown is not None and not thrown.is_window:
        return {"type": "point", "picture": thrown.file, **facing}
    picture = {"picture": thrown.file} if thrown is not None else {}
    return {"type": "spot", "falloff": "smooth", **facing, **picture} if data.type == "SPOT" else {"type": "point"}


def _size_factor(data: Any, scale: Any) -> float:
    """Returns the factor of a light's power that is due to its size.

    It is 1 unless "Normalize" is off: then the light's area, or for a sun the projected solid angle of its disk.
    """
    if getattr(data, "normalize", True):
        return 1.0
    if data.type == "SUN":
        return math.pi * math.sin(min(data.angle, math.pi) / 2) ** 2 or 1.0
    if data.type != "AREA":
        return 4 * math.pi * data.shadow_soft_size**2 or 1.0
    width, height = data.size, data.size_y if data.shape in ("RECTANGLE", "ELLIPSE") else data.size
    area = float(abs(width * scale.x * height * scale.y))
    return area * (math.pi / 4 if data.shape in ("DISK", "ELLIPSE") else 1.0)
