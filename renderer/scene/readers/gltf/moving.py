"""The animated parts of a glTF file, by its channels; all other parts are reused between frames."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from renderer.scene.readers.gltf.container import Json
from renderer.scene.readers.replaced_values import Path

__all__ = ["AnimatedParts"]

_PLACE = ("translation", "rotation", "scale")
_SURFACE = ("emissiveFactor", "emissiveStrength", "anisotropyStrength")  # properties that affect how geometry is compiled


class AnimatedParts:
    """The animated nodes, materials and meshes, by the animated paths in the file's JSON.

    Nodes inherit motion from their parents.
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
        """Extends motion to the children of moving nodes. parents: of the scene's nodes, each after its parent."""
        for index, parent in parents.items():
            if parent in self._appearing:
                self._appearing.add(index)
            if parent in self.nodes or index in self._appearing:
                self.nodes.add(index)
        self._shown = {self._where[index] for index in self._appearing}
        self._shaped = {self._where[index] for index in self.reshaped}

    def appears(self, node: Json) -> bool:
        """Returns True if a node's visibility is animated."""
        return node.where in self._shown

    def unshared_shape_key(self, node: Json) -> str | None:
        """Returns a key for a node with its own animated morph weights, whose shape is not shared; None for other nodes."""
        return node.where if node.where in self._shaped else None

    @property
    def only_transforms_move(self) -> bool:
        """True if only transforms and shapes are animated."""
        return self._is_of_places

    def reshapes(self, mesh: int, node: Json) -> bool:
        """Returns True if a node's mesh has animated morph weights."""
        return node.where in self._shaped or ("weights" not in node and mesh in self.meshes)
