"""Parses OBJ statements into arrays: one pass over the bytes counts the statements, a second one fills the arrays.

Source: Alias/Wavefront, Advanced Visualizer Manual, appendix B1.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.jit import builder, device
from renderer.kernel.text.numbers import read_number
from renderer.sentences import Sentence

__all__ = ["Statements", "parse"]

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
I32 = npt.NDArray[np.int32]
Bytes = npt.NDArray[np.uint8]
Offsets = npt.NDArray[np.int64]

_TAB, _NEWLINE, _RETURN, _SPACE, _HASH, _PLUS, _MINUS, _DOT, _SLASH, _BACKSLASH = 9, 10, 13, 32, 35, 43, 45, 46, 47, 92
_OTHER, _V, _VT, _VN, _F, _USEMTL, _MTLLIB, _NO_SURFACE, _S, _O = range(10)
_NO_ERROR, _TOO_FEW, _NO_CORNER, _NOT_THERE = range(4)
_ABSENT, _LOST = -1, -2  # a corner's UV or normal index: absent, or out of range


class Statements(NamedTuple):
    """The contents of an OBJ file. Indices begin at 0; -1 means none."""

    positions: npt.NDArray[Any]  # (V, 3), in the dtype of `exact` (renderer/scene/origin.py); NaN if not finite
    colors: F32 | None  # (V, 3), NaN where a vertex has none
    uvs: F32  # (U, 2)
    normals: F32  # (N, 3)
    corners: I32  # (C, 3): position, uv, normal
    starts: Offsets  # (F + 1,): the corners of face i are starts[i] to starts[i + 1]
    materials: list[tuple[int, str]]  # (first face, material name) of each stretch
    libraries: list[str]
    others: int  # number of lines, points and curves
    smooth: list[tuple[int, str]]  # (first face, smoothing group) of each stretch
    objects: list[int]  # the first face of each object
    lost: int  # number of UV and normal indices out of range


def parse(data: bytes, file: str) -> Statements:
    """Parses a file in UTF-8, with other bytes escaped as by `surrogateescape`.

    Raises SceneError, with the line, for invalid statements.
    """
    text = np.frombuffer(data, np.uint8)
    counts = _count(text)
    positions, colors = np.empty((counts[_V], 3)), np.empty((counts[_V], 3), np.float32)
    uvs, normals = np.empty((counts[_VT], 2), np.float32), np.empty((counts[_VN], 3), np.float32)
    corners, starts = np.empty((counts[_OTHER], 3), np.int32), np.zeros(counts[_F] + 1, np.int64)
    names = np.empty((counts[_USEMTL] + counts[_MTLLIB] + counts[_S] + counts[_O], 4), np.int64)
    code, at, value, known, colored = _fill(text, positions, colors, uvs, normals, corners, starts, names)
    if code != _NO_ERROR:
        raise _error(code, at, value, known, data, file)
    corners = corners[: starts[-1]]
    lost = 0
    for k, table in enumerate((positions, uvs, normals)):
        highest = corners[:, k].max(initial=-1)
        if k == 0 and highest >= len(table):
            raise SceneError(
                Sentence(
                    "obj-vertex-out-of-range",
                    "{file}: a face refers to vertex {index}, but there are {count}; export it again",
                    file=file,
                    index=highest + 1,
                    count=len(table),
                )
            )
        if k and (highest >= len(table) or corners[:, k].min(initial=0) == _LOST or not np.isfinite(table).all()):
            odd = (corners[:, k] >= len(table)) | (corners[:, k] == _LOST)
            if len(table):
                odd |= (corners[:, k] >= 0) & ~np.all(np.isfinite(table), axis=1)[np.clip(corners[:, k], 0, len(table) - 1)]
            lost += int(odd.sum())
            corners[odd, k] = _ABSENT
    materials, libraries, smooth, objects = [], [], [], []
    for kind, face, begin, end in names.tolist():
        name = data[begin:end].decode("utf-8", "surrogateescape").strip()
        if kind == _USEMTL:
            materials.append((face, name))
        elif kind == _S:
            smooth.append((face, name))
        elif kind == _O:
            objects.append(face)
        else:
            libraries.append(name)
    own = colors if colored else None
    others = int(counts[_NO_SURFACE])
    return Statements(positions, own, uvs, normals, corners, starts, materials, libraries, others, smooth, objects, lost)


def _error(code: int, at: int, value: int, known: int, data: bytes, file: str) -> SceneError:
    line = data.count(b"\n", 0, at) + 1
    if code == _NOT_THERE:
        return SceneError(
            Sentence(
                "obj-face-reference-invalid",
                "{file}, line {line}: a face refers to element {index}, but {count} are defined before it",
                file=file,
                line=line,
                index=value,
                count=known,
            )
        )
    if code == _NO_CORNER:
        word = data[at : at + 200].split(None, 1)[0].decode("utf-8", "replace")
        return SceneError(
            Sentence(
                "obj-face-corner-malformed",
                "{file}, line {line}: {word} is not a corner of a face; write it as v/vt/vn",
                file=file,
                line=line,
                word=repr(word[:40]),
            )
        )
    row = " ".join(data[at:].split(b"\n", 1)[0][:200].decode("utf-8", "replace").split())
    return SceneError(
        Sentence(
            "obj-line-too-few-numbers",
            "{file}, line {line}: '{text}' does not contain {count} numbers; export the file again",
            file=file,
            line=line,
            text=row[:60],
            count=known,
        )
    )


@device
def _skip(text: Bytes, i: int) -> int:
    """Returns the index of the first non-blank byte at or after `i`; a backslash and the line end after it count as blanks."""
    n = len(text)
    while i < n:
        c = text[i]
        if c == _BACKSLASH and i + 1 < n and text[i + 1] == _NEWLINE:
            i += 2
        elif c == _BACKSLASH and i + 2 < n and text[i + 1] == _RETURN and text[i + 2] == _NEWLINE:
            i += 3
        elif c in (_SPACE, _TAB, _RETURN):
            i += 1
        else:
            break
    return i


@device
def _past_word(text: Bytes, i: int) -> int:
    n = len(text)
    while i < n and text[i] > _SPACE and not (text[i] == _BACKSLASH and i + 1 < n and text[i + 1] <= _RETURN):
        i += 1
    return i


@device
def _line_end(text: Bytes, i: int) -> int:
    n = len(text)
    while i < n and text[i] != _NEWLINE:
        if text[i] == _BACKSLASH:
            i = max(_skip(text, i), i + 1)
        else:
            i += 1
    return i


@device
def _keyword(text: Bytes, i: int, end: int) -> int:
    length = end - i
    c = text[i]
    if length == 1:
        if c == ord("v"):
            return _V
        if c == ord("f"):
            return _F
        if c == ord("s"):
            return _S
        if c == ord("o"):
            return _O
        return _NO_SURFACE if c == ord("l") or c == ord("p") else _OTHER
    if length == 2:
        if c == ord("v") and text[i + 1] == ord("t"):
            return _VT
        return _VN if c == ord("v") and text[i + 1] == ord("n") else _OTHER
    if length == 4 and text[i + 1] == ord("u") and text[i + 2] == ord("r"):
        return (
            _NO_SURFACE if (c == ord("c") and text[i + 3] == ord("v")) or (c == ord("s") and text[i + 3] == ord("f")) else _OTHER
        )
    if length == 6:
        if c == ord("u") and text[i + 1] == ord("s") and text[i + 3] == ord("m"):
            return _USEMTL
        return _MTLLIB if c == ord("m") and text[i + 1] == ord("t") and text[i + 3] == ord("l") else _OTHER
    return _OTHER


@builder
def _count(text: Bytes) -> Offsets:
    """Returns the number of statements of each kind; the entry _OTHER is the number of words in faces."""
    found = np.zeros(10, np.int64)
    i = 0
    while i < len(text):
        i = _skip(text, i)
        end = _past_word(text, i)
        if end > i:
            kind = _keyword(text, i, end)
            if kind != _OTHER:
                found[kind] += 1
            i = end
            if kind == _F:
                i = _skip(text, i)
                while i < len(text) and text[i] != _NEWLINE and text[i] != _HASH:
                    found[_OTHER] += 1
                    i = _skip(text, max(_past_word(text, i), i + 1))
        i = _line_end(text, i) + 1
    return found


@device
def _is_word_of_no_number(text: Bytes, i: int) -> bool:
    """Returns True if a non-finite number (nan, inf or infinity, with or without a sign) begins at index `i` of the text."""
    if i < len(text) and (text[i] == _PLUS or text[i] == _MINUS):
        i += 1
    if i + 2 >= len(text):
        return False
    a, b, c = text[i] | 32, text[i + 1] | 32, text[i + 2] | 32
    return (a == ord("n") and b == ord("a") and c == ord("n")) or (a == ord("i") and b == ord("n") and c == ord("f"))


@device
def _row(text: Bytes, i: int, needed: int, wanted: int, row: F64) -> tuple[int, int]:
    """Reads up to `wanted` numbers of a line into `row`, with NaN for non-finite ones.

    Returns (error code, count of numbers read).
    """
    count = 0
    while count < wanted:
        i = _skip(text, i)
        value, end = read_number(text, i)
        if end == i:
            if not _is_word_of_no_number(text, i):
                break
            value, end = np.nan, _past_word(text, i)
        row[count] = value
        if not np.isfinite(np.float32(value)):
            row[count] = np.nan
        count += 1
        i = end
    return (_NO_ERROR if count >= needed else _TOO_FEW), count


@device
def _integer(text: Bytes, i: int) -> tuple[int, int]:
    """Returns (the integer at `i`, or 0 if there is none; the index after it)."""
    n = len(text)
    negative = i < n and text[i] == _MINUS
    if negative or (i < n and text[i] == _PLUS):
        i += 1
    value = 0
    while i < n and ord("0") <= text[i] <= ord("9"):
        value = min(value * 10 + (text[i] - ord("0")), 1 << 40)
        i += 1
    return (-value if negative else value), i


@builder
def _fill(
    text: Bytes, positions: F64, colors: F32, uvs: F32, normals: F32, corners: I32, starts: Offsets, names: Offsets
) -> tuple[int, int, int, int, bool]:
    """Fills the arrays with the contents of an OBJ file, in a second pass over its text, for which they have the right sizes.

    corners: indices of position, uv and normal of each corner. starts: first corner of each face. names: the kind, the next face,
    and the begin and end in the text of each statement that names an object, group or material. Returns (error code, its place
    in the text, the offending index, the expected count of numbers, whether any vertex has a colour).
    """
    row = np.zeros(6)
    known = np.zeros(3, np.int64)  # positions, uvs, normals so far
    corner, face, name, colored = 0, 0, 0, False
    i = 0
    while i < len(text):
        i = _skip(text, i)
        begin, end = i, _past_word(text, i)
        kind = _keyword(text, i, end) if end > i else _OTHER
        i = end
        if kind == _V:
            code, count = _row(text, i, 3, 6, row)
            if code != _NO_ERROR:
                return code, begin, 0, 3, False
            colored = colored or count == 6
            for c in range(3):
                positions[known[0], c] = row[c]
                colors[known[0], c] = row[3 + c] if count == 6 else np.nan
            known[0] += 1
        elif kind == _VT:
            row[1] = 0
            code, count = _row(text, i, 1, 2, row)
            if code != _NO_ERROR:
                return code, begin, 0, 2, False
            uvs[known[1], 0], uvs[known[1], 1] = row[0], row[1]
            known[1] += 1
        elif kind == _VN:
            code, count = _row(text, i, 3, 3, row)
            if code != _NO_ERROR:
                return code, begin, 0, 3, False
            for c in range(3):
                normals[known[2], c] = row[c]
            known[2] += 1
        elif kind == _F:
            i = _skip(text, i)
            while i < len(text) and text[i] != _NEWLINE and text[i] != _HASH:
                word, past = i, max(_past_word(text, i), i + 1)
                corners[corner, 1] = corners[corner, 2] = -1
                for k in range(3):
                    value, i = _integer(text, i)
                    if i < past and text[i] != _SLASH:
                        return _NO_CORNER, word, 0, 0, False
                    at = value - 1 if value > 0 else known[k] + value
                    if k == 0 and (value == 0 or at < 0 or at >= (1 << 31) - 1):
                        return _NOT_THERE, word, value, known[k], False
                    if value != 0:
                        corners[corner, k] = at if 0 <= at < (1 << 31) - 1 else _LOST
                    if i >= past:
                        break
                    i += 1
                corner += 1
                i = _skip(text, past)
            face += 1
            starts[face] = corner
        elif kind in (_USEMTL, _MTLLIB, _S, _O):
            names[name, 0], names[name, 1] = kind, face
            names[name, 2], names[name, 3] = i, _line_end(text, i)
            name += 1
        i = _line_end(text, i) + 1
    return _NO_ERROR, 0, 0, 0, colored
