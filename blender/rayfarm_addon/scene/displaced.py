"""A material's displacement as bumps: what Cycles makes of it unless told to move the surface, and what stands for that."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from .nodes import At, Plain, Product, Source, followed

__all__ = ["Heights", "displaced"]


class Heights:
    """A Displacement node in the place of a Bump node. scale: of the object, in whose lengths it counts."""

    def __init__(self, source: Source, scale: float) -> None:
        self._source = source
        self._scale = 1.0 if getattr(source.node, "space", "OBJECT") == "WORLD" else scale
        self.node = SimpleNamespace(invert=False, type="BUMP")

    def input(self, *names: str) -> Any:
        """What a Bump node would have there."""
        if names[0] == "Strength":
            return Plain(1.0)
        if names[0] == "Distance":
            return Product(self._source.input("Scale"), Plain(self._scale))
        return self._source.input(*names)


def displaced(material: Any, tree: Any, scale: float, warn: Callable[[str], None]) -> Heights | None:
    """By which heights a bpy.types.Material is displaced; None where it is not, or by nothing that is read, which is told."""
    output = tree.get_output_node("CYCLES") or tree.get_output_node("ALL")
    if output is None or not output.inputs["Displacement"].is_linked:
        return None
    source, _ = followed(At(output.inputs["Displacement"]))
    if source is None or source.node.type != "DISPLACEMENT":
        warn("its displacement is left out; that by a Displacement node and a picture is shown as bumps")
        return None
    own = getattr(material, "cycles", None)
    if getattr(material, "displacement_method", getattr(own, "displacement_method", "BUMP")) != "BUMP":
        warn("its displacement is shown as bumps, which move no surface")
    return Heights(source, scale)
