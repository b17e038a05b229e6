"""Reads the value of a material's node socket: a constant, an image, or their product."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from .displacement import Heights
from .image_nodes import Bump, Painter
from .model import Scene, TextureUse
from .nodes import SocketInGroups, Source, constant_value, source_of

__all__ = ["GREY", "Value", "Values", "as_list", "number", "one_minus"]

WHITE = [1.0, 1.0, 1.0]
WRAPS = {"REPEAT": "repeat", "EXTEND": "clamp", "CLIP": "clamp", "MIRROR": "mirror"}
CHANNELS = {"Red": 0, "Green": 1, "Blue": 2, "R": 0, "G": 1, "B": 2, "Alpha": 3}
GREY = -1  # in place of a channel: the luminance, to which Blender converts a colour


@dataclass
class Value:
    """The value of a node socket: a constant factor, times an image if there is one.

    factor: a number or a list of three. image: a bpy.types.Image; use: its mapping, without the file's name; channel: of the
    image. vertex: the colour attribute that multiplies the value; "" for the active one, None for none.
    """

    factor: Any
    image: Any = None
    use: TextureUse | None = None
    channel: int | None = None
    inverted: bool = False
    vertex: str | None = None


def number(value: Any) -> float:
    """Returns the factor of a Value as a number: for a colour, the mean of its channels."""
    return sum(value) / len(value) if isinstance(value, list) else float(value)


def as_list(value: Any) -> list[float]:
    """Returns the factor of a Value as a colour: for a number, a grey."""
    return value if isinstance(value, list) else [float(value)] * 3


def one_minus(value: Value) -> Value:
    """Returns 1 minus the value."""
    if value.image is None:
        return Value(1 - number(value.factor))
    return replace(value, inverted=not value.inverted)


class Values:
    """Reads the values of the node sockets of one material.

    primary: the names of the UV maps that are exported as the first one of their meshes.
    """

    def __init__(self, scene: Scene, name: str, primary: set[str]) -> None:
        self._scene, self._name, self._primary = scene, name, primary
        self._painter = Painter(name, self._uv_mapping)

    def read(self, socket: Any, default: Any, what: str) -> Value:
        """Returns the value of a socket; if its source is not supported, the number set on the socket, with a warning.

        default: the value without a socket. what: the socket's name in the warning.
        """
        if socket is None:
            return Value(default)
        plain = constant_value(socket)
        if plain is not None:
            return Value(plain)
        source, _ = source_of(socket)
        found = None if source is None else self._read_source(source)
        if found is not None:
            if found.image is not None and found.channel is None and not isinstance(default, list):
                found.channel = GREY
            return found
        painted = self._painter.paint(socket, what)
        if isinstance(painted, list):
            return Value(painted if isinstance(default, list) else painted[0])
        if painted is not None:
            return Value(1.0, painted[0], painted[1], None if isinstance(default, list) else GREY)
        node = "" if source is None else f" ({source.node.bl_label or source.node.type})"
        self._scene.warn(f"Material {self._name}: what makes its {what}{node} is not read; a plain value stands for it.")
        own = getattr(getattr(socket, "socket", None), "default_value", default)
        return Value(default if own is None else [float(c) for c in own][:3] if hasattr(own, "__len__") else float(own))

    def bumps(self, source: Source | Heights, density: Callable[[int], tuple[float, float] | None]) -> Value | None:
        """Returns the normal map of a Bump node whose height is an image; None for other heights.

        density: returns the surface's length per UV unit, as `stretched` does.
        """
        numbers = [constant_value(source.input(name)) for name in ("Strength", "Distance")]
        if any(not isinstance(each, float) for each in numbers):
            return None
        strength, distance = numbers

        def length(use: TextureUse) -> tuple[float, float] | None:
            whole = density(use.uv_set)
            return None if not whole or 0 in use.scale else (whole[0] / abs(use.scale[0]), whole[1] / abs(use.scale[1]))

        bump = Bump(min(max(strength, 0.0), 1.0), -distance if source.node.invert else distance)
        found = self._painter.bumps(source.input("Height"), bump, length)
        return None if found is None else Value(WHITE, found[0], found[1])

    def _read_source(self, source: Source) -> Value | None:
        node, kind = source.node, source.node.type
        if kind == "TEX_IMAGE" and node.image is not None:
            channel = 3 if source.output.name == "Alpha" else None
            use = self._uv_mapping(source)
            return None if use is None else Value(1.0, node.image, use, channel)
        if kind in ("SEPARATE_COLOR", "SEPRGB"):
            inner = self._value_of_source(source.input_at(0))
            if inner is None or inner.image is None or inner.channel is not None:
                return None
            inner.channel = CHANNELS.get(source.output.name)
            return inner if inner.channel is not None else None
        if kind == "INVERT":
            inner = self._value_of_source(source.input("Color"))
            if inner is None or constant_value(source.input("Fac", "Factor")) != 1.0 or inner.factor != 1.0:
                return None
            inner.inverted = not inner.inverted
            return inner
        if kind in ("VERTEX_COLOR", "ATTRIBUTE") and source.output.name in ("Color", "Alpha"):
            return Value(1.0, vertex=node.layer_name if kind == "VERTEX_COLOR" else node.attribute_name)
        if kind == "RGBTOBW":
            return self._value_of_source(source.input_at(0))
        if kind in ("MIX", "MIX_RGB"):
            return self._read_mix(source)
        if kind == "MATH" and node.operation == "MULTIPLY":
            return self._product(source.input_at(0), source.input_at(1))
        return None

    def _value_of_source(self, socket: SocketInGroups | None) -> Value | None:
        plain = constant_value(socket)
        if plain is not None:
            return Value(plain)
        source, _ = source_of(socket)
        return None if source is None else self._read_source(source)

    def _read_mix(self, source: Source) -> Value | None:
        node = source.node
        if node.type == "MIX" and node.data_type != "RGBA":
            return None
        # The Mix node since Blender 3.4 has sockets of every type; those for colours are the last.
        first, second = (
            (source.input_at(6), source.input_at(7)) if node.type == "MIX" else (source.input_at(1), source.input_at(2))
        )
        share = constant_value(source.input_at(0))
        if share == 0.0:
            return self._value_of_source(first)
        if share != 1.0:
            return None
        if node.blend_type == "MIX":
            return self._value_of_source(second)
        return self._product(first, second) if node.blend_type == "MULTIPLY" else None

    def _product(self, first: SocketInGroups, second: SocketInGroups) -> Value | None:
        a, b = self._value_of_source(first), self._value_of_source(second)
        if a is None or b is None or (a.image is not None and b.image is not None):
            return None
        if a.inverted or b.inverted or (a.vertex is not None and b.vertex is not None):
            return None
        told = a if a.image is not None else b
        factor = _times(a.factor, b.factor)
        vertex = a.vertex if a.vertex is not None else b.vertex
        return Value(factor, told.image, told.use, told.channel, False, vertex)

    def _uv_mapping(self, source: Source) -> TextureUse | None:
        """Returns the mapping of an image or pattern node on the surface; None if it is not mapped by UVs."""
        node = source.node
        is_image = node.type == "TEX_IMAGE"
        if is_image and node.projection != "FLAT":
            return None
        wrap = WRAPS.get(getattr(node, "extension", ""), "repeat")
        nearest = getattr(node, "interpolation", "") == "Closest"
        lies = _TexturePlacement()
        at = source.input("Vector")
        for _ in range(4):
            found, _ = source_of(at)
            if found is None:
                if not is_image:
                    return None  # without a Vector input, patterns use generated coordinates, images UVs
                break
            kind = found.node.type
            if kind == "MAPPING":
                if not lies.map(found):
                    return None
                at = found.input("Vector")
                continue
            if kind == "UVMAP":
                lies.uv_set = self._set(found.node.uv_map)
                break
            if kind == "TEX_COORD" and found.output.name == "UV":
                break
            if kind == "ATTRIBUTE":
                lies.uv_set = self._set(found.node.attribute_name)
                break
            return None
        return TextureUse("", lies.uv_set, (wrap, wrap), nearest, lies.offset, lies.rotation, lies.scale)

    def _set(self, name: str) -> int:
        return 0 if not name or name in self._primary else 1


class _TexturePlacement:
    def __init__(self) -> None:
        self.uv_set = 0
        self.offset, self.rotation, self.scale = (0.0, 0.0), 0.0, (1.0, 1.0)

    def map(self, source: Source) -> bool:
        """Applies a Mapping node to this mapping.

        Returns False if the node is not a rotation, scale and translation in the UV plane.
        """
        if source.node.vector_type != "POINT" or self.offset != (0.0, 0.0) or self.rotation or self.scale != (1.0, 1.0):
            return False
        location, turn, scale = (constant_value(source.input(name)) for name in ("Location", "Rotation", "Scale"))
        if location is None or turn is None or scale is None or abs(turn[0]) > 1e-6 or abs(turn[1]) > 1e-6:
            return False
        # v points upwards in Blender and downwards in glTF: the same mapping with v flipped before and after.
        x, y, angle = location[0], location[1], turn[2]
        self.scale, self.rotation = (scale[0], scale[1]), angle
        self.offset = (x - scale[1] * math.sin(angle), 1 - y - scale[1] * math.cos(angle))
        return True


def _times(a: Any, b: Any) -> Any:
    if isinstance(a, list) or isinstance(b, list):
        first, second = (v if isinstance(v, list) else [v] * 3 for v in (a, b))
        return [x * y for x, y in zip(first, second, strict=True)]
    return a * b
