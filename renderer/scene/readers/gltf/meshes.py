"""glTF's meshes with their materials, read when a node first shows them."""

from __future__ import annotations

import numpy as np

from renderer.scene.closed import is_closed
from renderer.scene.description import Mesh
from renderer.scene.readers.gltf.accessors import Accessors
from renderer.scene.readers.gltf.container import Json
from renderer.scene.readers.gltf.materials import Materials
from renderer.scene.readers.gltf.primitives import read_primitive
from renderer.scene.textures import TextureShelf

__all__ = ["Meshes"]


class Meshes:
    """The description's meshes by glTF mesh."""

    def __init__(self, root: Json, accessors: Accessors, materials: Materials, shelf: TextureShelf, meshes: list[Mesh]) -> None:
        self.sources = root.objects("meshes")
        self._accessors, self._materials, self._shelf, self._meshes = accessors, materials, shelf, meshes
        self._read: dict[int, list[int]] = {}

    def name(self, index: int) -> str:
        """What the file calls a mesh."""
        return self.sources[index].text("name", "") or f"mesh {index}"

    def of(self, index: int) -> list[int]:
        """The description's numbers of a mesh's primitives."""
        if index not in self._read:
            primitives: list[tuple[Mesh, int | None]] = []
            for source in self.sources[index].objects("primitives"):
                material = source.index("material", self._materials.sources)
                mesh = read_primitive(source, self.name(index), self._accessors, self._shelf)
                if mesh is not None:
                    mesh.material = self._materials.number(material)
                    primitives.append((mesh, material))
            self._refract(primitives)
            first = len(self._meshes)
            self._meshes += [mesh for mesh, _ in primitives]
            self._read[index] = list(range(first, len(self._meshes)))
        return self._read[index]

    def _refract(self, primitives: list[tuple[Mesh, int | None]]) -> None:
        """Makes panes of what light goes through and has no inside, by itself or with the mesh's other primitives."""
        transparent = [(mesh, m) for mesh, m in primitives if m is not None and self._materials.depends_on_mesh(m)]
        if not transparent or _bound_a_volume([mesh for mesh, _ in primitives]):
            return
        for mesh, material in transparent:
            if len(primitives) == 1 or not is_closed(mesh.positions, mesh.triangles):
                mesh.material = self._materials.pane(material)


def _bound_a_volume(meshes: list[Mesh]) -> bool:
    offsets = np.cumsum([0, *(len(m.positions) for m in meshes)])
    positions = np.concatenate([m.positions for m in meshes])
    return is_closed(positions, np.concatenate([m.triangles + o for m, o in zip(meshes, offsets, strict=False)]))
