"""Parses 3MF's long lists of vertices and triangles quickly: uniformly written rows need no XML parser.

Such a list is cut out of the XML and replaced by a processing instruction with its number. The XML parser then reports where the
list belongs, also next to empty lists, lists with attributes, and comments that contain lists.
"""

from __future__ import annotations

import math
import re
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.kernel.text.rows import read_rows
from renderer.sentences import Sentence

__all__ = ["MARK", "Rows", "cut_out", "transform_of"]

MARK = "rayfarm-rows"  # target of the processing instruction

_LIST = re.compile(rb"<((?:\w+:)?(vertices|triangles))\s*>")
_OPENING = re.compile(rb"<(?:\w+:)?(?P<tag>\w+)\s+(?P<name>[A-Za-z]\w*)\s*=\s*\"")
_ATTRIBUTE = re.compile(rb"\"\s+(?P<name>[A-Za-z]\w*)\s*=\s*\"")
_CLOSING = re.compile(rb"\"\s*/>")
_TAGS = {b"vertices": b"vertex", b"triangles": b"triangle"}
_KNOWN = {b"vertex": {b"x", b"y", b"z"}, b"triangle": {b"v1", b"v2", b"v3", b"pid", b"p1", b"p2", b"p3"}}
_NEEDED = {b"vertex": {b"x", b"y", b"z"}, b"triangle": {b"v1", b"v2", b"v3"}}
_MOST_ROW = 1000  # bytes


class Rows(NamedTuple):
    """A list of vertices or triangles as columns of equal length, by attribute name."""

    columns: dict[str, npt.NDArray[Any]]

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def stacked(self, names: tuple[str, ...]) -> npt.NDArray[Any]:
        """Returns (N, len(names)) values of several columns. Raises KeyError if a column is missing."""
        return np.stack([self.columns[name] for name in names], axis=1)


def cut_out(data: bytes) -> tuple[bytes, list[Rows]]:
    """Returns a part's XML without its lists of vertices and triangles, and these lists by number.

    Lists whose rows are not written uniformly remain in the XML.
    """
    text = np.frombuffer(data, np.uint8)
    found: list[Rows] = []
    kept: list[bytes] = []
    at = taken = 0
    while (opening := _LIST.search(data, at)) is not None:
        end = data.find(b"</" + opening[1], opening.end())
        if end < 0:
            break
        rows = _rows(data, text, opening.end(), end, _TAGS[opening[2]])
        if rows is not None:
            kept.append(data[taken : opening.end()] + b"<?%s %d?>" % (MARK.encode(), len(found)))
            found.append(rows)
            taken = end
        at = end
    return b"".join([*kept, data[taken:]]), found


def _rows(data: bytes, text: npt.NDArray[np.uint8], begin: int, end: int, tag: bytes) -> Rows | None:
    alike = _row_pattern(data[begin : min(end, begin + _MOST_ROW)].lstrip(), tag)
    if alike is None:
        return None
    names, words = alike
    starts = np.cumsum([0, *map(len, words)])
    least = int(starts[-1]) + len(names)  # minimum bytes of a row: one per number
    table = np.empty(((end - begin) // least, len(names)), np.float64)
    count = read_rows(text, begin, end, np.frombuffer(b"".join(words), np.uint8), starts, table)
    if count < 1:
        return None
    table = table[:count]
    if tag == b"triangle":
        whole = table.astype(np.int64)
        if (whole != table).any():
            return None
        return Rows({name: whole[:, k] for k, name in enumerate(names)})
    return Rows({name: table[:, k] for k, name in enumerate(names)})


def _row_pattern(row: bytes, tag: bytes) -> tuple[list[str], list[bytes]] | None:
    """Returns the attribute names of a list's first row, and the texts around their values; None if it is not a row of this kind.

    The texts include the one before the first value and the one after the last.
    """
    names: list[bytes] = []
    words: list[bytes] = []
    pattern, at = _OPENING, 0
    while (found := pattern.match(row, at)) is not None:
        if pattern is _OPENING and found["tag"] != tag:
            return None
        names.append(found["name"])
        words.append(found[0])
        at = row.find(b'"', found.end())
        pattern = _ATTRIBUTE
    closing = _CLOSING.match(row, at) if names else None
    if closing is None or len(set(names)) < len(names) or not _NEEDED[tag] <= set(names) <= _KNOWN[tag]:
        return None
    return [name.decode() for name in names], [*words, closing[0]]


def transform_of(words: str) -> npt.NDArray[np.float64]:
    """Returns the (4, 4) matrix for column vectors from 3MF's twelve numbers, which are for row vectors.

    Raises ValueError if malformed.
    """
    found = np.eye(4)
    if words.strip():
        numbers = [float(word) for word in words.split()]
        if len(numbers) != 12 or not all(math.isfinite(n) for n in numbers):
            raise ValueError(Sentence("3mf-transform-malformed", "a transform is not twelve finite numbers"))
        found[:3] = np.array(numbers).reshape(4, 3).T
    return found
