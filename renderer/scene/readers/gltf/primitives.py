"""Reads the primitives of glTF meshes; each becomes one Mesh (specification 3.7.2)."""

from __future__ import annotations

import itertools
from pathlib import PurePosixPath
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.scene.description import F32, Mesh
from renderer.scene.readers.gltf import draco
from renderer.scene.readers.gltf.accessors import Accessors, as_floats
from renderer.scene.readers.gltf.container import Json
from renderer.scene.readers.gltf.deform import Bones
from renderer.scene.readers.gltf.faults import DamagedError
from renderer.scene.readers.gltf.points_and_lines import mesh_of_points_or_lines
from renderer.scene.readers.gltf.textures import UV_SETS
from renderer.scene.textures import TextureShelf
from renderer.sentences import Sentence

__all__ = ["Primitive", "read_primitive"]

_LIST, _STRIP, _FAN = 4, 5, 6
_FIBRE = "_FIBRE"  # ours, written by blender/: the direction of the hair around which a mesh lies, and its diameter


class Primitive(NamedTuple):
    """A primitive's mesh, morph targets, and joints with weights."""

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
    """Returns a primitive; None, with a warning, for points and lines if no thickness is given.

    uv_sets: numbers of the file's UV sets to read. Raises DamagedError if positions or indices are unusable; other unusable
    attributes are left out.
    """
    mode = source.integer("mode", high=7) if "mode" in source else _LIST
    if mode < _LIST and thickness is None:
        shelf.warn(
            Sentence(
                "gltf-points-lines-left-out",
                "Mesh {name}: its points or lines have no surface and are left out. To see them, give "
                "them a thickness in a scene file: shapes: [{type: mesh, file: {file}, thickness: "
                "0.01}].",
                name=name,
                file=PurePosixPath(source.file).name,
            )
        )
        return None
    attributes = _Attributes(source, accessors)
    for bare in attributes.undecoded_accessors():
        accessors.count_empty_accessor(bare)
    positions = attributes.positions()
    if positions is None:
        shelf.warn(Sentence("gltf-mesh-without-positions", "Mesh {name}: has no positions and is left out.", name=name))
        return None
    indices: npt.NDArray[np.integer] | None = attributes.indices
    if indices is None:
        at = source.integer("indices", high=len(accessors.accessors)) if "indices" in source else None
        indices = np.arange(len(positions), dtype=np.int64) if at is None else accessors.integers(at)
    if not indices.size:
        raise source.damage(
            "attributes" if "indices" not in source else "indices", Sentence("gltf-vertices-missing", "has no vertices")
        )
    if mode < _LIST and thickness is not None:
        if _is_bad(indices, len(positions)).any() or not np.isfinite(positions).all():
            raise source.damage(
                "indices",
                Sentence(
                    "gltf-vertex-index-invalid",
                    "has indices outside of its vertices, or positions that are not finite numbers",
                ),
            )
        shown = mesh_of_points_or_lines(name, positions, indices, mode, _with_alpha(attributes.get("COLOR_0", (3, 4))), thickness)
        if shown is None:
            shelf.warn(
                Sentence(
                    "gltf-points-lines-collapsed",
                    "Mesh {name}: its points or lines are all in one place and left out.",
                    name=name,
                )
            )
            return None
        if source.objects("targets") or "JOINTS_0" in attributes:
            shelf.warn(
                Sentence(
                    "gltf-points-lines-undeformed",
                    "Mesh {name}: skins and morph targets do not deform its points or lines.",
                    name=name,
                )
            )
        return Primitive(shown, [], None)
    mode = _LIST if attributes.indices is not None else mode
    if mode == _LIST and (left := len(indices) % 3):
        source.fault("indices", Sentence("gltf-triangle-incomplete", "ends with {left} of a triangle's three indices", left=left))
    triangles = _triangles(indices, mode)
    positions, triangles = _without_bad_triangles(source, positions, triangles)
    mesh = Mesh(name, positions, triangles.astype(np.int32))
    count = len(positions)
    mesh.normals = attributes.of_vertices("NORMAL", (3,), count)
    mesh.uvs, mesh.uvs1, *_ = (*(attributes.of_vertices(f"TEXCOORD_{number}", (2,), count) for number in uv_sets), None)
    if mesh.normals is not None:  # specification 3.7.2.1
        mesh.tangents = attributes.of_vertices("TANGENT", (4,), count)
        fibres = attributes.of_vertices(_FIBRE, (4,), count)
        if fibres is not None:
            mesh.tangents = np.column_stack([fibres[:, :3], np.ones(count, np.float32)])
            mesh.diameters = np.maximum(fibres[:, 3], 0)
    mesh.colors = _with_alpha(attributes.of_vertices("COLOR_0", (3, 4), count))
    return Primitive(mesh, source.objects("targets"), _bones(attributes, source, count))


def _is_bad(indices: npt.NDArray[np.integer], count: int) -> npt.NDArray[np.bool_]:
    return (indices < 0) | (indices >= count)


def _without_bad_triangles(
    source: Json, positions: F32, triangles: npt.NDArray[np.integer]
) -> tuple[F32, npt.NDArray[np.integer]]:
    """Removes triangles whose vertices are missing or not finite; returns the positions and the remaining triangles.

    Raises DamagedError if no triangle remains.
    """
    bad = np.asarray(_is_bad(triangles, len(positions)).any(axis=1))
    if bad.any():
        largest = int(triangles.max())
        what = Sentence(
            "gltf-triangle-index-out-of-range",
            "has the index {index} where there are {vertices} vertices, in {count} triangles",
            index=largest,
            vertices=len(positions),
            count=int(bad.sum()),
        )
        if bad.all():
            raise source.damage("indices", what)
        source.fault("indices", what)
        triangles = triangles[~bad]
    finite = np.asarray(np.isfinite(positions).all(axis=1))
    if finite.all():
        return positions, triangles
    needed = ~np.asarray(finite[triangles].all(axis=1))
    what = Sentence(
        "gltf-positions-not-finite",
        "has positions that are not finite numbers, in {count} triangles",
        count=int(needed.sum()),
    )
    if needed.all():
        raise source.damage("attributes", what)
    source.fault("attributes", what)
    positions = np.where(finite[:, None], positions, positions[np.argmax(finite)])
    return positions, triangles[~needed]


class _Attributes:
    """The arrays of a primitive by attribute name, from accessors or from a Draco block."""

    def __init__(self, source: Json, accessors: Accessors) -> None:
        found = source.object("attributes")
        if found is None:
            raise source.damage("attributes", Sentence("gltf-value-missing", "is missing"))
        self._source, self._attributes, self._accessors = source, found, accessors
        compressed = source.extension(draco.EXTENSION)
        self.indices: npt.NDArray[np.int64] | None = None
        self._decoded: dict[str, npt.NDArray[Any]] = {}
        if compressed:
            self.indices, self._decoded = draco.decode(compressed, accessors)

    def __contains__(self, key: str) -> bool:
        return key in self._attributes

    def has_bones_beyond(self, count: int) -> bool:
        """Returns True if the primitive has JOINTS_n or WEIGHTS_n attributes with n >= `count`."""
        words = (key.partition("_") for key in self._attributes.value)
        return any(kind in ("JOINTS", "WEIGHTS") and number.isdigit() and int(number) >= count for kind, _, number in words)

    def undecoded_accessors(self) -> list[int]:
        """Returns the accessors (by index) of the primitive's vertex indices and positions, except those in a Draco block."""
        known = self._accessors.accessors
        found = None if self.indices is not None else self._source.index("indices", known)
        places = None if "POSITION" in self._decoded else self._attributes.index("POSITION", known)
        return [at for at in (found, places) if at is not None]

    def positions(self) -> F32 | None:
        """Returns (V, 3) positions, not necessarily finite; None if absent. Raises DamagedError if they are unusable."""
        if "POSITION" not in self._decoded and "POSITION" in self._attributes:
            self._attributes.integer("POSITION", high=len(self._accessors.accessors))
        return self._values("POSITION", (3,), finite=False)

    def get(self, key: str, widths: tuple[int, ...]) -> F32 | None:
        """Returns the (count, width) float32 values of an attribute, with a width among `widths`; None if absent or unusable."""
        try:
            return self._values(key, widths)
        except DamagedError as fault:
            self._source.faults.add(fault)
            return None

    def of_vertices(self, key: str, widths: tuple[int, ...], count: int) -> F32 | None:
        """Returns the values of an attribute if there is one per vertex; otherwise counts a fault and returns None.

        count: number of vertices.
        """
        values = self.get(key, widths)
        if values is not None and len(values) != count:
            self._attributes.fault(
                key,
                Sentence(
                    "gltf-value-count-wrong", "has {found} values for {vertices} vertices", found=len(values), vertices=count
                ),
            )
            return None
        return values

    def _values(self, key: str, widths: tuple[int, ...], finite: bool = True) -> F32 | None:
        at = self._attributes.index(key, self._accessors.accessors)
        if key not in self._decoded:
            return None if at is None else self._accessors.floats(at, *widths, finite=finite)
        normalized = at is not None and self._accessors.accessors[at].value.get("normalized") is True
        values = as_floats(self._decoded[key], normalized)
        if values.shape[1] not in widths:
            raise self._attributes.damage(
                key, Sentence("gltf-component-count-wrong", "has {numbers} numbers per vertex", numbers=values.shape[1])
            )
        if finite and not np.isfinite(values).all():
            raise self._attributes.damage(key, Sentence("gltf-values-not-finite", "contains values that are not finite numbers"))
        return values


def _bones(attributes: _Attributes, source: Json, count: int) -> Bones | None:
    joints, weights = [], []
    for k in itertools.count():  # sets of four joints each
        if f"JOINTS_{k}" not in attributes or f"WEIGHTS_{k}" not in attributes:
            break
        of = attributes.of_vertices(f"JOINTS_{k}", (4,), count)
        by = attributes.of_vertices(f"WEIGHTS_{k}", (4,), count)
        if of is None or by is None:
            continue
        if of.min(initial=0) < 0:
            source.fault("attributes", Sentence("gltf-joint-negative", "has negative joints in JOINTS_{set}", set=k))
            continue
        joints.append(of.astype(np.int64))
        weights.append(np.maximum(by, 0))
    if attributes.has_bones_beyond(k):
        source.fault(
            "attributes",
            Sentence(
                "gltf-joint-weights-unmatched",
                "have joints without weights, weights without joints, or a gap between sets",
            ),
        )
    return Bones(np.concatenate(joints, axis=1), np.concatenate(weights, axis=1)) if joints else None


def _with_alpha(colors: F32 | None) -> F32 | None:
    if colors is None:
        return None
    colors = np.clip(colors, 0, 1)
    if colors.shape[1] == 3:
        colors = np.concatenate([colors, np.ones((len(colors), 1), np.float32)], axis=1)
    return None if (colors == 1).all() else colors  # all white: no effect


def _triangles(indices: npt.NDArray[np.integer], mode: int) -> npt.NDArray[np.integer]:
    """Returns (T, 3) vertex indices of a triangle list, strip or fan. mode: the primitive's mode in glTF."""
    if mode == _LIST:
        return indices[: len(indices) // 3 * 3].reshape(-1, 3)
    count = max(len(indices) - 2, 0)
    i = np.arange(count)
    if mode == _STRIP:  # every second triangle is wound the other way: p_i, p_(i + 1 + i % 2), p_(i + 2 - i % 2)
        corners = np.stack([i, i + 1 + i % 2, i + 2 - i % 2], axis=1)
    else:
        corners = np.stack([i + 1, i + 2, np.zeros_like(i)], axis=1)
    return indices[corners].reshape(-1, 3)
