"""glTF's meshes: one Mesh a primitive (specification 3.7.2)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.scene.description import F32, I32, Mesh
from renderer.scene.readers.gltf import draco
from renderer.scene.readers.gltf.accessors import Accessors
from renderer.scene.readers.gltf.container import Json
from renderer.scene.readers.gltf.materials import UvUse
from renderer.scene.textures import TextureShelf

__all__ = ["read_primitive"]

_LIST, _STRIP, _FAN = 4, 5, 6


def read_primitive(source: Json, name: str, use: UvUse, accessors: Accessors, shelf: TextureShelf) -> Mesh | None:
    """The mesh of a primitive, its material not yet set; None, with a warning, for points and lines."""
    mode = source.integer("mode", _LIST, high=7)
    if mode < _LIST:
        shelf.warn(f"Mesh {name}: its points or lines have no surface and are left out.")
        return None
    attributes = source.object("attributes")
    if attributes is None:
        raise source.wrong("attributes", "is missing")
    compressed = source.extension(draco.EXTENSION)
    if compressed:
        indices, decoded = draco.decode(compressed, accessors)
    else:
        indices, decoded = None, {}

    def attribute(key: str, width: int) -> F32 | None:
        if key in decoded:
            values = decoded[key]
            if values.shape[1] != width or not np.isfinite(values).all():
                raise source.wrong("attributes", f"has a damaged {key}")
            return values
        at = attributes.index(key, accessors.accessors)
        return None if at is None else accessors.floats(at, width)

    positions = attribute("POSITION", 3)
    if positions is None:
        shelf.warn(f"Mesh {name}: has no positions and is left out.")
        return None
    if "COLOR_0" in attributes:
        shelf.warn(f"Mesh {name}: its vertex colours are not rendered yet.")
    if "targets" in source:
        shelf.warn(f"Mesh {name}: its morph targets are not applied; it has its base shape.")
    if indices is None:
        at = source.index("indices", accessors.accessors)
        indices = np.arange(len(positions), dtype=np.int64) if at is None else accessors.integers(at)
    if indices.size and (indices.min() < 0 or indices.max() >= len(positions)):
        raise SceneError(
            f"{source.file}: {source.where} has the index {int(indices.max())} where there are {len(positions)} vertices; "
            "export the file again"
        )
    uvs = attribute(f"TEXCOORD_{use.uv_set}", 2)
    if uvs is None:
        uvs = attribute("TEXCOORD_0", 2)
    if uvs is not None and use.transform != UvUse().transform:
        matrix = np.array(use.transform, np.float32).reshape(2, 3)
        uvs = uvs @ matrix[:, :2].T + matrix[:, 2]
    normals = attribute("NORMAL", 3)
    for key, values in (("NORMAL", normals), ("TEXCOORD", uvs)):
        if values is not None and len(values) != len(positions):
            raise source.wrong("attributes", f"has {len(values)} of {key} and {len(positions)} of POSITION")
    return Mesh(name, positions, _triangles(indices, _LIST if compressed else mode), normals, uvs)


def _triangles(indices: npt.NDArray[np.int64], mode: int) -> I32:
    if mode == _LIST:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3).astype(np.int32)
    count = max(len(indices) - 2, 0)
    i = np.arange(count)
    if mode == _STRIP:  # every second triangle is wound the other way: p_i, p_(i + 1 + i % 2), p_(i + 2 - i % 2)
        corners = np.stack([i, i + 1 + i % 2, i + 2 - i % 2], axis=1)
    else:
        corners = np.stack([i + 1, i + 2, np.zeros_like(i)], axis=1)
    return indices[corners].reshape(-1, 3).astype(np.int32)
