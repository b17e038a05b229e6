"""The long lists of 3MF's meshes, read in one go: rows that are all written alike, as programs do, need no XML parser.

Such a list is taken out of the XML, and a processing instruction with its number stands in its place. So the parser itself says
where it belongs, whatever else there is: empty lists, lists with attributes, comments with lists in them.
"""

from __future__ import annotations

import re
import warnings
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

__all__ = ["MARK", "Rows", "cut_out"]

MARK = "rayfarm-rows"  # of the processing instruction

PIECE = 1 << 22
_LISTS = re.compile(rb"<(?:\w+:)?(vertices|triangles)\s*>(.*?)</(?:\w+:)?\1\s*>", re.DOTALL)
_OPENING = re.compile(rb"<(?:\w+:)?(?P<tag>\w+)\s+(?P<name>[A-Za-z]\w*)\s*=\s*")
_ATTRIBUTE = re.compile(rb"\s+(?P<name>[A-Za-z]\w*)\s*=\s*")
_ROW = {b"vertices": (b"vertex", np.float64), b"triangles": (b"triangle", np.int64)}
_KNOWN = {b"vertex": {b"x", b"y", b"z"}, b"triangle": {b"v1", b"v2", b"v3", b"pid", b"p1", b"p2", b"p3"}}
_NEEDED = {b"vertex": {b"x", b"y", b"z"}, b"triangle": {b"v1", b"v2", b"v3"}}


class Rows(NamedTuple):
    """A list's columns, by their attributes' names; all as long."""

    columns: dict[str, npt.NDArray[Any]]

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def stacked(self, names: tuple[str, ...]) -> npt.NDArray[Any]:
        """(N, len(names)). Raises KeyError where one is not there."""
        return np.stack([self.columns[name] for name in names], axis=1)


def cut_out(data: bytes) -> tuple[bytes, list[Rows]]:
    """A part's XML without its lists of vertices and triangles, and these by their numbers.

    A list whose rows differ is left as it is, for the parser.
    """
    found: list[Rows] = []
    kept: list[bytes] = []
    at = 0
    for match in _LISTS.finditer(data):
        rows = _rows(data, match.start(2), match.end(2), *_ROW[match[1]])
        if rows is not None:
            kept.append(data[at : match.start(2)] + b"<?%s %d?>" % (MARK.encode(), len(found)))
            at = match.end(2)
            found.append(rows)
    return b"".join([*kept, data[at:]]), found


def _rows(data: bytes, begin: int, end: int, tag: bytes, kind: type) -> Rows | None:
    names: list[bytes] = []
    pieces: list[npt.NDArray[Any]] = []
    while begin < end:
        stop = data.rfind(b"/>", begin, min(begin + PIECE, end)) + 2
        if stop <= begin + 1:
            return None if data[begin:end].strip() else _joined(names, pieces)
        piece = data[begin:stop].strip()
        given = _names(piece, tag)
        if given is None or (names and given != names):
            return None
        names = given
        numbers = _numbers(piece, len(names), kind)
        if numbers is None:
            return None
        pieces.append(numbers)
        begin = stop
    return _joined(names, pieces)


def _joined(names: list[bytes], pieces: list[npt.NDArray[Any]]) -> Rows | None:
    if not pieces:
        return None
    whole = np.concatenate(pieces)
    return Rows({name.decode(): whole[:, k] for k, name in enumerate(names)})


def _names(piece: bytes, tag: bytes) -> list[bytes] | None:
    """The attributes of a piece's first row; None where it is no row of this tag."""
    words = piece[: piece.find(b"/>") + 2].split(b'"')
    found = [_OPENING.fullmatch(words[0]), *map(_ATTRIBUTE.fullmatch, words[2:-1:2])]
    names = [match["name"] for match in found if match is not None]
    if len(names) < len(found) or len(set(names)) < len(names) or found[0] is None or found[0]["tag"] != tag:
        return None
    return names if _NEEDED[tag] <= set(names) <= _KNOWN[tag] else None


def _numbers(piece: bytes, width: int, kind: type) -> npt.NDArray[Any] | None:
    """(N, width) the values of rows that are written alike; None where one is not."""
    parts = piece.split(b'"')
    values, between = parts[1::2], parts[0::2]
    if len(values) % width or len(between) != len(values) + 1 or between[-1] != b"/>":
        return None
    others = between[width:-1:width]  # what the rows after the first begin with
    if others and (others[0][:2] != b"/>" or others[0][2:].lstrip() != between[0]):
        return None
    if not all(_is_one(each) for each in (others, *(between[k::width] for k in range(1, width)))):
        return None
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            found: npt.NDArray[Any] = np.fromstring(b" ".join(values), kind, sep=" ")
        except (ValueError, DeprecationWarning):
            return None
    return found.reshape(-1, width) if len(found) == len(values) else None


def _is_one(words: list[bytes]) -> bool:
    return not words or words.count(words[0]) == len(words)
