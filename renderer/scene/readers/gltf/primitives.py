"""glTF's meshes: one Mesh a primitive (specification 3.7.2)."""

from __future__ import annotations

import itertools
from pathlib import PurePosixPath
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.scene.description import F32, I32, Mesh
from renderer.scene.readers.gltf import draco
from renderer.scene.readers.gltf.accessors import Accessors, as_floats
from renderer.scene.readers.gltf.container import Json
from renderer.scene.readers.gltf.deform import Bones
from renderer.scene.readers.gltf.textures import UV_SETS
from renderer.scene.readers.gltf.thickened import thickened
from renderer.scene.textures import TextureShelf

__all__ = ["Primitive", "read_primitive"]

_LIST, _STRIP, _FAN = 4, 5, 6


class Primitive(NamedTuple):
    """A primitive as its file has it."""

    mesh: Mesh  # its material not yet set
    targets: list[Json]
    bones: Bones | None


def read_primitive(
    source: Json,
    name: str,
    accessors: Accessors,
    shelf: TextureShelf,
    thickness: float | None = None,
    uv_sets: tuple[int, ...] = UV_SETS,
) -> Primitive | None:
    """The primitive, with these of the file's sets of UVs; None, with a warning, for points and lines without a thickness."""
    mode = source.integer("mode", _LIST, high=7)
    if mode < _LIST and thickness is None:
        shelf.warn(
            f"Mesh {name}: its points or lines have no surface and are left out. To see them, give them a thickness in a scene "
            f"file: shapes: [{{type: mesh, file: {PurePosixPath(source.file).name}, thickness: 0.01}}]."
        )
        return None
    attributes = _Attributes(source, accessors)
    for bare in attributes.bare():
        accessors.judge_bare(bare)
    positions = attributes.get("POSITION", (3,))
    if positions is None:
        shelf.warn(f"Mesh {name}: has no positions and is left out.")
        return None
    indices: npt.NDArray[np.integer] | None = attributes.indices
    if indices is None:
        at = source.index("indices", accessors.accessors)
        indices = np.arange(len(positions), dtype=np.int64) if at is None else accessors.integers(at)
    if indices.size and (indices.min() < 0 or indices.max() >= len(positions)):
        raise SceneError(
            f"{source.file}: {source.where} has the index {int(indices.max())} where there are {len(positions)} vertices; "
            "export the file again"
        )
    if mode < _LIST and thickness is not None:
        shown = thickened(name, positions, indices, mode, _with_alpha(attributes.get("COLOR_0", (3, 4))), thickness)
        if shown is None:
            shelf.warn(f"Mesh {name}: its points or lines are all in one place, and left out.")
            return None
        if source.objects("targets") or "JOINTS_0" in attributes:
            shelf.warn(f"Mesh {name}: its points or lines are not bent by a skin or by morph targets.")
        return Primitive(shown, [], None)
    mesh = Mesh(name, positions, _triangles(indices, _LIST if attributes.indices is not None else mode))
    mesh.normals = attributes.get("NORMAL", (3,))
    mesh.uvs, mesh.uvs1, *_ = (*(attributes.get(f"TEXCOORD_{number}", (2,)) for number in uv_sets), None)
    mesh.tangents = attributes.get("TANGENT", (4,)) if mesh.normals is not None else None  # specification 3.7.2.1
    mesh.colors = _with_alpha(attributes.get("COLOR_0", (3, 4)))
    for values in (mesh.normals, mesh.uvs, mesh.uvs1, mesh.tangents, mesh.colors):
        if values is not None and len(values) != len(positions):
            raise source.wrong("attributes", f"has {len(values)} of an attribute and {len(positions)} of POSITION")
    return Primitive(mesh, source.objects("targets"), _bones(attributes, source, len(positions)))


class _Attributes:
    """A primitive's arrays by name, from accessors or, where it is compressed, from Draco's block."""

    def __init__(self, source: Json, accessors: Accessors) -> None:
        found = source.object("attributes")
        if found is None:
            raise source.wrong("attributes", "is missing")
        self._source, self._attributes, self._accessors = source, found, accessors
        compressed = source.extension(draco.EXTENSION)
        self.indices: npt.NDArray[np.int64] | None = None
        self._decoded: dict[str, npt.NDArray[Any]] = {}
        if compressed:
            self.indices, self._decoded = draco.decode(compressed, accessors)

    def __contains__(self, key: str) -> bool:
        return key in self._attributes

    def bare(self) -> list[int]:
        """The accessors of positions and indices, which Draco's block does not hold."""
        known = self._accessors.accessors
        found = None if self.indices is not None else self._source.index("indices", known)
        places = None if "POSITION" in self._decoded else self._attributes.index("POSITION", known)
        return [at for at in (found, places) if at is not None]

    def get(self, key: str, widths: tuple[int, ...]) -> F32 | None:
        """(count, width) float32, of one of the widths; None where the primitive has none."""
        at = self._attributes.index(key, self._accessors.accessors)
        if key not in self._decoded:
            return None if at is None else self._accessors.floats(at, *widths)
        normalized = at is not None and self._accessors.accessors[at].value.get("normalized") is True
        values = as_floats(self._decoded[key], normalized)
        if values.shape[1] not in widths or not np.isfinite(values).all():
            raise self._source.wrong("attributes", f"has a damaged {key}")
        return values


def _bones(attributes: _Attributes, source: Json, count: int) -> Bones | None:
    joints, weights = [], []
    for k in itertools.count():  # sets of four joints each
        of, by = attributes.get(f"JOINTS_{k}", (4,)), attributes.get(f"WEIGHTS_{k}", (4,))
        if of is None or by is None:
            break
        if len(of) != count or len(by) != count or of.min(initial=0) < 0:
            raise source.wrong("attributes", f"has {len(of)} of JOINTS_{k}, {len(by)} of WEIGHTS_{k} and {count} of POSITION")
        joints.append(of.astype(np.int64))
        weights.append(np.maximum(by, 0))
    return Bones(np.concatenate(joints, axis=1), np.concatenate(weights, axis=1)) if joints else None


def _with_alpha(colors: F32 | None) -> F32 | None:
    if colors is None:
        return None
    colors = np.clip(colors, 0, 1)
    if colors.shape[1] == 3:
        colors = np.concatenate([colors, np.ones((len(colors), 1), np.float32)], axis=1)
    return None if (colors == 1).all() else colors  # white changes nothing


def _triangles(indices: npt.NDArray[np.integer], mode: int) -> I32:
    if mode == _LIST:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3).astype(np.int32)
    count = max(len(indices) - 2, 0)
    i = np.arange(count)
    if mode == _STRIP:  # every second triangle is wound the other way: p_i, p_(i + 1 + i % 2), p_(i + 2 - i % 2)
        corners = np.stack([i, i + 1 + i % 2, i + 2 - i % 2], axis=1)
    else:
        corners = np.stack([i + 1, i + 2, np.zeros_like(i)], axis=1)
    return indices[corners].reshape(-1, 3).astype(np.int32)
