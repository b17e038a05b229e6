"""A glTF file at another moment: what its channels move is put elsewhere, the rest is as it was read."""

from __future__ import annotations

from copy import copy
from dataclasses import fields

from renderer.scene.animation import Moment
from renderer.scene.description import SceneDescription
from renderer.scene.readers.gltf.animation import Animations
from renderer.scene.readers.gltf.nodes import Nodes

__all__ = ["Again"]


class Again:
    """A file that was read, of which nothing but places and shapes moves. Readers add to lists only, and so does who compiles."""

    def __init__(self, animations: Animations, nodes: Nodes, description: SceneDescription) -> None:
        self._animations, self._nodes = animations, nodes
        description.still = self
        self._read = {field.name: copy(getattr(description, field.name)) for field in fields(description)}
        self._read["still"] = self

    def at(self, moment: Moment, description: SceneDescription) -> bool:
        """Makes an empty description what the file is at a moment; False where it has to be read anew. Raises SceneError."""
        before = {field.name: getattr(description, field.name) for field in fields(description)}
        for name, value in self._read.items():
            setattr(description, name, copy(value) if isinstance(value, list | dict) else value)
        if self._nodes.walk_again(self._animations.at(moment), description):
            return True
        for name, value in before.items():
            setattr(description, name, value)
        return False
