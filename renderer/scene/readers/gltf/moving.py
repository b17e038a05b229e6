"""Finds the animated parts of a glTF file from its channels; all other parts are reused between frames."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from renderer.scene.readers.gltf.container import Json
from renderer.scene.readers.replaced_values import Path

__all__ = ["AnimatedParts"]

_PLACE = ("translation", "rotation", "scale")
_SURFACE = ("emissiveFactor", "emissiveStrength", "anisotropyStrength")  # properties that affect how geometry is compiled


class AnimatedParts:
    """The nodes, materials and meshes of a file that are animated, found from the animated paths in its JSON.

    Nodes inherit the motion of their parents.
    """

    def __init__(self, root: Json, paths: Iterable[Path]) -> None:
        self.nodes: set[int] = set()  # with animated transform or visibility
        self.surfaces: set[int] = set()  # the file's material indices
        self._appearing: set[int] = set()
        self.meshes: set[int] = set()  # with animated default weights
        self.reshaped: set[int] = set()  # nodes with animated weights
        self._shown: set[str] = set()  # by the nodes' paths
        self._shaped: set[str] = set()
        self._where = [node.where for node in root.objects("nodes")]
        self._is_of_places = True
        for path in paths:
            family, number = path[0], path[1]
            self._is_of_places &= path[2] == "weights" or (family == "nodes" and path[2] in _PLACE)
            if not isinstance(number, int):
                continue
            if family == "nodes" and path[2] in _PLACE:
                self.nodes.add(number)
            elif family == "nodes" and path[2] == "weights":
                self.reshaped.add(number)
            elif family == "nodes":
                self._appearing.add(number)
            elif family == "meshes":
                self.meshes.add(number)
            elif family == "materials" and path[-1] in _SURFACE:
                self.surfaces.add(number)

    def extend_to_children(self, parents: Mapping[int, int | None]) -> None:
        """Adds the children of animated nodes to the animated nodes.

        parents: the parent of each node of the scene, in an order that has parents first.
        """
        for index, parent in parents.items():
            if parent in self._appearing:
                self._appearing.add(index)
            if parent in self.nodes or index in self._appearing:
                self.nodes.add(index)
        self._shown = {self._where[index] for index in self._appearing}
        self._shaped = {self._where[index] for index in self.reshaped}

    def appears(self, node: Json) -> bool:
        """Returns True if a node's visibility is animated, so that the node appears or disappears."""
        return node.where in self._shown

    def unshared_shape_key(self, node: Json) -> str | None:
        """Returns a key for a node with animated morph weights of its own; None for all other nodes.

        The deformed mesh of such a node cannot be shared with other nodes.
        """
        return node.where if node.where in self._shaped else None

    @property
    def only_transforms_move(self) -> bool:
        """True if nothing but transforms and shapes is animated."""
        return self._is_of_places

    def reshapes(self, mesh: int, node: Json) -> bool:
        """Returns True if the morph weights that apply to a node's mesh are animated."""
        return node.where in self._shaped or ("weights" not in node and mesh in self.meshes)
