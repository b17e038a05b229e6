"""Finds the colour channels of an image by their names.

OpenEXR names a channel `layer.channel`. Only the part after the last dot describes its content, and only channels of one layer
belong together. Source: "Technical Introduction to OpenEXR", Channel Names and Layers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

__all__ = ["Colour", "colour_of"]

_PARTS = {
    **dict.fromkeys(("r", "red"), "r"),
    **dict.fromkeys(("g", "green"), "g"),
    **dict.fromkeys(("b", "blue"), "b"),
    **dict.fromkeys(("a", "alpha"), "a"),
    **dict.fromkeys(("y", "l", "luminance", "grey", "gray"), "y"),
    **{name: name for name in ("ry", "by", "x", "z")},
}
_PICTURES = ("", "combined", "beauty", "rgba", "rgb", "color", "colour", "image", "composite")
_NO_PICTURES = ("crypto", "depth", "normal", "vector", "position", "mist", "uv", "index")


class Colour(NamedTuple):
    """The colour channels of an image.

    part, layer: the part of the file, and the layer in it, that contain these channels. kind: "rgb", "y" or "chroma" (Y, RY, BY).
    channels: short name (r, g, b, a, y, ry, by) -> index in the part; missing ones are 0. others: further layers that could have
    been meant.
    """

    part: int
    layer: str
    kind: str
    channels: dict[str, int]
    others: list[str]


class _Layer(NamedTuple):
    part: int
    name: str
    channels: dict[str, int]

    @property
    def kind(self) -> str | None:
        names = self.channels.keys()
        if names >= {"y", "ry", "by"}:
            return "chroma"
        if names & {"r", "g", "b"}:
            return "rgb"
        if names >= {"x", "y", "z"}:
            return "xyz"
        return "y" if "y" in names or len(names - {"a"}) == 1 else None

    def rank(self) -> tuple[int, int]:
        """Returns the sort key by which a layer is chosen: pictures before data, layers with all colours first."""
        kind = self.kind
        complete = (
            0
            if {"r", "g", "b"} <= self.channels.keys() or kind == "chroma"
            else 1
            if kind == "rgb" or "y" in self.channels
            else 2
        )
        if kind == "xyz":
            complete = 2
        last = self.name.rpartition(".")[2].lower()
        if last in _PICTURES:
            return complete, int(last != "")
        return complete, 3 if last.startswith(_NO_PICTURES) else 2


def colour_of(parts: Sequence[tuple[str, Sequence[str]]]) -> Colour | None:
    """Returns an image's colour channels; None if no channel name identifies them. parts: (name, channel names) of each part."""
    layers = [layer for part, (title, names) in enumerate(parts) for layer in _layers(part, title, names)]
    usable = sorted((layer for layer in layers if layer.kind is not None), key=_Layer.rank)
    if not usable:
        return None
    best = usable[0]
    channels, kind = best.channels, str(best.kind)
    if kind == "xyz":
        channels, kind = {"r": channels["x"], "g": channels["y"], "b": channels["z"]}, "rgb"
    elif kind == "y" and "y" not in channels:
        channels = {("a" if name == "a" else "y"): number for name, number in channels.items()}
    same = [layer.name for layer in usable[1:] if layer.rank()[0] == best.rank()[0]]
    return Colour(best.part, best.name, kind, channels, same if best.rank()[1] > 1 else [])


def _layers(part: int, title: str, names: Sequence[str]) -> list[_Layer]:
    found: dict[str, dict[str, int]] = {}
    for number, name in enumerate(names):
        layer, _, last = name.rpartition(".")
        found.setdefault(layer or title, {}).setdefault(_PARTS.get(last.lower(), last), number)
    return [_Layer(part, layer, channels) for layer, channels in found.items()]
