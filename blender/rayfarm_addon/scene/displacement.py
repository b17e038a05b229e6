"""Finds the displacement of materials: as bump mapping, the default in Cycles, or as one that moves surfaces."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from ..farm.protocol.sentences import Sentence
from .nodes import ConstantValue, Product, SocketInGroups, Source, constant_value, source_of

__all__ = ["DISPLACEMENT", "Heights", "displaced"]

DISPLACEMENT = "RAYFARM_materials_displacement"  # read by the farm, by renderer/scene/material.py


class Heights:
    """A Displacement node that can be evaluated in place of a Bump node: it has the same methods and inputs.

    scale: the object's scale, by which heights are multiplied unless the node's space is the world's.
    moves: whether the displacement moves the surface.
    """

    def __init__(self, source: Source, scale: float, moves: bool) -> None:
        self._source, self._object_scale, self.moves = source, scale, moves
        self._scale = 1.0 if getattr(source.node, "space", "OBJECT") == "WORLD" else scale
        self.node = SimpleNamespace(invert=False, type="BUMP")

    def input(self, *names: str) -> Any:
        """Returns the socket or constant that stands for an input of a Bump node, given by one or more alternative names."""
        if names[0] == "Strength":
            return ConstantValue(1.0)
        if names[0] == "Distance":
            return Product(self._source.input("Scale"), ConstantValue(self._scale))
        return self._source.input(*names)

    def parameters(self, factor: float) -> dict[str, float] | None:
        """Returns the scale and the midlevel of `DISPLACEMENT`, in object space; None unless they are constants.

        factor: by which the values of the height texture are multiplied.
        """
        scale, middle = (constant_value(self._source.input(name)) for name in ("Scale", "Midlevel"))
        if not isinstance(scale, float) or not isinstance(middle, float) or factor == 0:
            return None
        if getattr(self._source.node, "space", "OBJECT") == "WORLD":
            scale /= self._object_scale or 1.0
        return {"displacementScale": scale * factor, "displacementMidlevel": middle / factor}


def displaced(material: Any, tree: Any, scale: float, warn: Callable[[str], None]) -> Heights | None:
    """Returns the displacement of a bpy.types.Material, which is also a source for bump mapping.

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
                "its displacement is left out; only that by a Displacement node with an image is shown",
            )
        )
        return None
    own = getattr(material, "cycles", None)
    return Heights(source, scale, getattr(material, "displacement_method", getattr(own, "displacement_method", "BUMP")) != "BUMP")
