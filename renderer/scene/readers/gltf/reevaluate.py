"""Re-evaluates a glTF file at another moment: only its animated parts are updated."""

from __future__ import annotations

from copy import copy
from dataclasses import fields

from renderer.scene.animation import Moment
from renderer.scene.description import SceneDescription
from renderer.scene.readers.gltf.animation import Animations
from renderer.scene.readers.gltf.nodes import Nodes

__all__ = ["Reevaluation"]


class Reevaluation:
    """A glTF file that was read once, for reading it again at other moments; only its transforms and shapes are animated.

    Its lists may be shared, since readers and the compiler only append to them.
    """

    def __init__(self, animations: Animations, nodes: Nodes, description: SceneDescription) -> None:
        self._animations, self._nodes = animations, nodes
        description.still = self
        self._read = {field.name: copy(getattr(description, field.name)) for field in fields(description)}
        self._read["still"] = self

    def fill_at(self, moment: Moment, description: SceneDescription) -> bool:
        """Fills an empty description with the file at another moment. Returns False if the file must be read again.

        Raises SceneError if the moment's clip does not exist or is damaged.
        """
        before = {field.name: getattr(description, field.name) for field in fields(description)}
        for name, value in self._read.items():
            setattr(description, name, copy(value) if isinstance(value, list | dict) else value)
        if self._nodes.update_nodes(self._animations.root_at(moment), description):
            return True
        for name, value in before.items():
            setattr(description, name, value)
        return False
