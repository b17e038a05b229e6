"""Substitutes for Blender's shader nodes, with which the add-on's node reader is tested without Blender."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from blender.rayfarm_addon.scene.nodes import SocketInGroups

__all__ = ["Image", "Node", "at", "image_node", "linked", "ramp", "socket"]


class Sockets(list):
    def get(self, name: str) -> Any:
        return next((each for each in self if each.name == name), None)

    def __getitem__(self, key: Any) -> Any:
        return super().__getitem__(key) if isinstance(key, int) else self.get(key)


def socket(name: str, value: Any = None) -> SimpleNamespace:
    return SimpleNamespace(name=name, identifier=name, default_value=value, links=[], is_linked=False)


class Node:
    """Substitute for a shader node. kind: Blender's node type. inputs: values by socket name.

    more: further properties of the node.
    """

    def __init__(self, kind: str, inputs: dict[str, Any], outputs: tuple[str, ...] = ("Color",), **more: Any) -> None:
        self.type, self.bl_label, self.mute, self.name = kind, kind.title(), False, kind
        self.inputs = Sockets(socket(name, value) for name, value in inputs.items())
        self.outputs = Sockets(socket(name) for name in outputs)
        for name, value in more.items():
            setattr(self, name, value)


def linked(source: Node, into: Node, name: str | int, output: str | int = 0) -> Node:
    """Links an output of `source` to the input `name` of `into`; returns `into`."""
    entry = into.inputs[name]
    link = SimpleNamespace(from_node=source, from_socket=source.outputs[output], is_valid=True, is_muted=False)
    entry.links, entry.is_linked = [link], True
    return into


def at(source: Node, output: str | int = 0) -> SocketInGroups:
    """Returns an input socket that an output of `source` is connected to, in the form in which the add-on reads sockets."""
    end = linked(source, Node("END", {"in": 0.0}), "in", output)
    return SocketInGroups(end.inputs[0])


def ramp(*stops: tuple[float, tuple[float, float, float]]) -> Any:
    """Returns a substitute colour ramp with linear interpolation between stops (position, colour)."""
    places = [place for place, _ in stops]

    def evaluate(x: float) -> list[float]:
        return [*(float(np.interp(x, places, [color[k] for _, color in stops])) for k in range(3)), 1.0]

    return SimpleNamespace(evaluate=evaluate)


class Image:
    """Substitute for a Blender image. pixels: encoded values (h, w, 3), top row first."""

    is_float, is_dirty, source, file_format, packed_file, channels = False, False, "GENERATED", "PNG", None, 4

    def __init__(self, name: str, values: np.ndarray, space: str = "sRGB") -> None:
        self.name, self.colorspace_settings = name, SimpleNamespace(name=space)
        self.size = (values.shape[1], values.shape[0])
        flat = np.ones((*values.shape[:2], 4), np.float32)
        flat[..., :3] = values
        self.pixels = SimpleNamespace(foreach_get=lambda into: into.__setitem__(slice(None), flat[::-1].ravel()))


def image_node(image: Image) -> Node:
    return Node(
        "TEX_IMAGE",
        {"Vector": None},
        ("Color", "Alpha"),
        image=image,
        projection="FLAT",
        extension="REPEAT",
        interpolation="Linear",
    )
