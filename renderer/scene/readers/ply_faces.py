"""PLY files whose faces have different numbers of corners, which trimesh does not read: their faces as triangles."""

from __future__ import annotations

import re
from typing import Literal, NamedTuple

import numpy as np

__all__ = ["evened"]

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_CORNERS = ("vertex_indices", "vertex_index")
_HEADER = re.compile(rb"\Aply\s.*?^end_header\r?\n", re.DOTALL | re.MULTILINE)
_Order = Literal["<", ">"]
_ORDERS: dict[str, _Order] = {"binary_little_endian": "<", "binary_big_endian": ">"}
_MOST = 20_000_000  # triangles


class _Element(NamedTuple):
    """A kind of rows. lists: (type of the count, type of the values, name)."""

    name: str
    number: int
    lists: list[tuple[str, str, str]]
    row: list[tuple[str, str]]  # its single values


def evened(data: bytes) -> bytes:
    """The same file with triangles alone, where it is binary and its faces differ; else as it is, whatever is wrong with it."""
    header = _HEADER.match(data[: 1 << 16])
    if header is None:
        return data
    words = header[0].decode("ascii", "replace").split()
    order = _ORDERS.get(words[words.index("format") + 1] if "format" in words[:-1] else "")
    elements = _elements(header[0])
    if order is None or elements is None:
        return data
    at = header.end()
    for element in elements:
        if element.name == "face":
            return _with_triangles(data, header[0], at, element, order)
        if element.lists:
            return data
        at += element.number * np.dtype(element.row).itemsize
    return data


def _elements(header: bytes) -> list[_Element] | None:
    found: list[_Element] = []
    for line in header.decode("ascii", "replace").splitlines():
        words = line.split()
        if words[:1] == ["element"] and len(words) == 3 and words[2].isdigit():
            found.append(_Element(words[1], int(words[2]), [], []))
        elif words[:1] == ["property"] and found:
            if len(words) == 5 and words[1] == "list" and words[2] in _TYPES and words[3] in _TYPES:
                found[-1].lists.append((_TYPES[words[2]], _TYPES[words[3]], words[4]))
            elif len(words) == 3 and words[1] in _TYPES:
                found[-1].row.append((words[2], _TYPES[words[1]]))
            else:
                return None
    return found


def _with_triangles(data: bytes, header: bytes, at: int, face: _Element, order: _Order) -> bytes:
    """Only of faces that hold their corners and nothing else: what else there is of them would have to be doubled too."""
    if len(face.lists) != 1 or face.row or face.lists[0][2] not in _CORNERS or face.lists[0][0] not in ("u1", "i1"):
        return data
    kind = np.dtype(face.lists[0][1]).newbyteorder(order)
    size, view = kind.itemsize, memoryview(data)
    if not 0 < face.number <= len(data) - at or _are_alike(data, at, face.number, size):
        return data
    counts = bytearray()
    begin, end, many = at, len(data), face.number
    while many and begin < end:
        corners = view[begin]
        counts.append(corners)
        begin += 1 + corners * size
        many -= 1
    if many or begin > end:
        return data
    count = np.frombuffer(counts, np.uint8).astype(np.int64)
    triangles = np.maximum(count - 2, 0)
    if not 0 < triangles.sum() <= _MOST:
        return data
    starts = at + 1 + np.concatenate([[0], np.cumsum(1 + count * size)[:-1]])
    first = np.repeat(starts, triangles)
    step = np.arange(len(first)) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    places = np.stack([first, first + (step + 1) * size, first + (step + 2) * size], axis=1)
    whole = np.frombuffer(data, np.uint8)
    rows = np.empty(len(first), [("count", "u1"), ("corners", kind, 3)])
    rows["count"] = 3
    rows["corners"] = np.ascontiguousarray(whole[places[..., None] + np.arange(size)]).view(kind)[..., 0]
    said = re.sub(rb"(element\s+face\s+)\d+", rb"\g<1>%d" % len(rows), header)
    return said + data[len(header) : at] + rows.tobytes() + data[begin:]


def _are_alike(data: bytes, at: int, faces: int, size: int) -> bool:
    """Whether all faces have as many corners as the first."""
    stride = 1 + data[at] * size
    if at + faces * stride > len(data):
        return False
    counts = np.frombuffer(data, np.uint8, faces * stride, at)[::stride]
    return bool((counts == data[at]).all())
