"""Imports text files with coordinates far from the origin exactly, while assimp reads them as float32.

Float32 rounds coordinates of a map projection (1e5 ... 6e6) to as little as 0.5. Numbers of a file that are close together and
far from zero, such as all northings, form a cluster. The file is imported once unchanged, and once with the clusters' centres
subtracted. A comparison shows which axis of a mesh, node, light or camera belongs to which cluster; the second import then
has the exact coordinates relative to the centre. All data other than positions are taken from the first import.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import PurePosixPath
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.scene.readers.assimp.library import Animation, Imported, Node, Shape, import_file

__all__ = ["import_exactly"]

F64 = npt.NDArray[np.float64]
Points = npt.NDArray[np.floating]

_TEXT = (
    ".ac",
    ".ac3d",
    ".ase",
    ".dae",
    ".irrmesh",
    ".nff",
    ".ogex",
    ".x",
    ".x3d",
    ".xgl",
)  # text formats with decimal numbers
_NUMBER = re.compile(rb"(?<![\w.+#&-])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w.])")
# Collada's elements and X3D's attributes with indices, counts and angles.
_INDICES = re.compile(
    rb"<(?:p|h|v|vcount|rotate|skew|scale)\b[^>]*>[^<]*|\b(?:\w*Index|count|rotation|orientation|scale)\s*=\s*[\"'][^\"']*"
)
_LEAST, _LARGE = 64.0, 4096.0  # float32 rounds to 4e-6, and to 2.5e-4
_FAR = 16.0  # in cluster sizes, as in renderer/scene/origin.py
_ULPS = 4 * 2.0**-24
_ALIKE = 0.3


def import_exactly(data: bytes, name: str) -> Imported:
    """Returns the contents of a file as `import_file` does, but with far coordinates in float64.

    Raises SceneError if the file cannot be imported.
    """
    found = import_file(data, name)
    if PurePosixPath(name).suffix.lower() not in _TEXT:
        return found
    shifted, centres = _subtract_centres(data)
    if not len(centres):
        return found
    try:
        near = import_file(shifted, name)
    except SceneError:
        return found
    if len(near.nodes) != len(found.nodes) or near.meshes.keys() != found.meshes.keys():
        return found
    return replace(
        found,
        nodes=[_node(*pair, centres) for pair in zip(found.nodes, near.nodes, strict=True)],
        meshes={number: _shape(shape, near.meshes[number], centres) for number, shape in found.meshes.items()},
        lamps=[_at_exact_position(*pair, centres, ("direction",)) for pair in zip(found.lamps, near.lamps, strict=True)],
        cameras=[_at_exact_position(*pair, centres, ("towards", "up")) for pair in zip(found.cameras, near.cameras, strict=True)],
        animations=[_animation(*pair, centres) for pair in zip(found.animations, near.animations, strict=True)],
    )


def _subtract_centres(data: bytes) -> tuple[bytes, F64]:
    """Subtracts from each far number in a text the centre of its cluster (see the module).

    Returns the changed text, and (n,) the clusters' centres.
    """
    indices = [match.span() for match in _INDICES.finditer(data)]
    starts = np.array([first for first, _ in indices], np.int64)
    ends = np.array([end for _, end in indices], np.int64)
    places, values = [], []
    for match in _NUMBER.finditer(data):
        if len(match[0]) > 1 and abs(value := float(match[0])) >= _LEAST and np.isfinite(value):
            before = int(np.searchsorted(starts, match.start(), "right")) - 1
            if before < 0 or match.start() >= ends[before]:
                places.append(match.span())
                values.append(value)
    number = np.array(values)
    large = number[np.abs(number) >= _LARGE]
    if (large.astype(np.float32) == large).all():
        return data, np.zeros(0)
    order = np.sort(number)
    steps = np.flatnonzero(np.diff(order) * _FAR > np.abs(order[:-1])) + 1
    clusters = [each for each in np.split(order, steps) if (each[-1] - each[0]) * _FAR < abs(each[0] + each[-1]) / 2]
    centres = np.array([np.rint((each[0] + each[-1]) / 2) for each in clusters])
    if not len(centres):
        return data, centres
    which = np.abs(number[:, None] - centres).argmin(axis=1)
    within = np.array([(each[0], each[-1]) for each in clusters])[which]
    moved = (number >= within[:, 0]) & (number <= within[:, 1])
    pieces, last = [], 0
    for k in np.flatnonzero(moved):
        first, end = places[k]
        pieces += [data[last:first], f"{number[k] - centres[which[k]]:.9f}".encode()]
        last = end
    return b"".join([*pieces, data[last:]]), centres


def _offset(found: Points, near: Points, centres: F64) -> F64 | None:
    """Returns the offset (3,) by which two imports of the same points differ: on each axis 0 or the centre of a cluster.

    found, near: (n, 3) points as imported from the unchanged file, and with the clusters' centres subtracted. centres: (n,)
    these centres. Returns None if the two do not differ by such an offset.
    """
    if not (np.isfinite(found).all() and np.isfinite(near).all()) or not (len(found) and len(near)):
        return None
    boxes = [np.stack([points.min(axis=0), points.max(axis=0)]).astype(np.float64) for points in (found, near)]
    difference = boxes[0] - boxes[1]
    known = np.concatenate([[0.0], centres])
    offset: F64 = known[np.abs(known - difference.mean(axis=0)[:, None]).argmin(axis=1)]
    allowed = _ULPS * (np.abs(boxes[0]).max(axis=0) + np.abs(boxes[1]).max(axis=0)) + 1e-6
    return offset if (np.abs(difference - offset) <= allowed).all() else None


def _shape(found: Shape, near: Shape, centres: F64) -> Shape:
    offset = _offset(found.positions, near.positions, centres)
    if offset is None or not offset.any() or found.bones:
        return found
    points: Any = near.positions.astype(np.float64) + offset
    return replace(near, positions=points, name=found.name, material=found.material)


def _node(found: Node, near: Node, centres: F64) -> Node:
    offset = _offset(found.local[None, :3, 3], near.local[None, :3, 3], centres)
    if offset is None or not offset.any():
        return found
    local = found.local.copy()
    if np.abs(found.local[:3, :3] - near.local[:3, :3]).max() <= _ALIKE:  # rotation to a far target: exact in `near` only
        local[:3, :3] = near.local[:3, :3]
    local[:3, 3] = near.local[:3, 3] + offset
    return replace(found, local=local)


def _at_exact_position(found: Any, near: Any, centres: F64, directions: tuple[str, ...]) -> Any:
    """Returns a light or camera with its position in float64, if the position is far from the origin; else returns `found`.

    found: the object as imported from the unchanged file. near: the same object as imported with the clusters' centres
    subtracted. centres: (n,) these centres. directions: names of the fields to copy from `near`, such as a direction.
    """
    offset = _offset(found.position[None], near.position[None], centres)
    if offset is None or not offset.any():
        return found
    return replace(found, position=near.position + offset, **{name: getattr(near, name) for name in directions})


def _animation(found: Animation, near: Animation, centres: F64) -> Animation:
    channels = []
    for one, other in zip(found.channels, near.channels, strict=False):
        offset = _offset(one.places[1], other.places[1], centres)
        if offset is not None and offset.any() and len(one.places[1]) == len(other.places[1]):
            one = replace(one, places=(one.places[0], other.places[1] + offset))
        channels.append(one)
    return replace(found, channels=channels) if len(channels) == len(found.channels) else found
