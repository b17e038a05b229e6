"""Exports material displacement as bump mapping, which is also the default in Cycles."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from ..farm.protocol.sentences import Sentence
from .nodes import ConstantValue, Product, SocketInGroups, Source, source_of

__all__ = ["Heights", "displaced"]


class Heights:
    """A Displacement node that can be evaluated in place of a Bump node: it has the same methods and inputs.

    scale: the object's scale, by which heights are multiplied unless the node's space is the world's.
    """

    def __init__(self, source: Source, scale: float) -> None:
        self._source = source
        self._scale = 1.0 if getattr(source.node, "space", "OBJECT") == "WORLD" else scale
        self.node = SimpleNamespace(invert=False, type="BUMP")

    def input(self, *names: str) -> Any:
        """Returns the socket or constant that stands for an input of a Bump node, given by one or more alternative names."""
        if names[0] == "Strength":
            return ConstantValue(1.0)
        if names[0] == "Distance":
            return Product(self._source.input("Scale"), ConstantValue(self._scale))
        return self._source.input(*names)


def displaced(material: Any, tree: Any, scale: float, warn: Callable[[str], None]) -> Heights | None:
    """Returns the displacement of a bpy.types.Material as a source for bump mapping.

    Returns None if the material has none, and None with a warning if it is not supported. scale: of the object.
    """
    output = tree.get_output_node("CYCLES") or tree.get_output_node("ALL")
    if output is None or not output.inputs["Displacement"].is_linked:
        return None
    source, _ = source_of(SocketInGroups(output.inputs["Displacement"]))
    if source is None or source.node.type != "DISPLACEMENT":
        warn(
            Sentence(
                "cycles-displacement-left-out",
                "its displacement is left out; only that by a Displacement node with an image is shown, as bumps",
            )
        )
        return None
    own = getattr(material, "cycles", None)
    if getattr(material, "displacement_method", getattr(own, "displacement_method", "BUMP")) != "BUMP":
        warn(Sentence("cycles-displacement-as-bumps", "its displacement is shown as bumps, without moving the surface"))
    return Heights(source, scale)
