"""Parses PLY elements into columns: text, or binary of either byte order, with lists of any length.

Source: Turk, "The PLY Polygon File Format", 1994.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.scene.text_encoding import as_utf8, decoded
from renderer.sentences import Sentence

__all__ = ["Element", "Lists", "elements", "textures_of"]

Array = npt.NDArray[Any]

_TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("int64", "longlong"), "i8"),
    **dict.fromkeys(("uint64", "ulonglong"), "u8"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_ORDERS = {"binary_little_endian": "<", "binary_big_endian": ">"}
_MOST_HEADER = 1 << 18
_HEADER = re.compile(rb"\Aply[ \t]*(\r\n|\n|\r)(?s:.*?)(?<=[\r\n])end_header[ \t]*(?:\1|\r\n|\n|\r)")
_TEXTURE = re.compile(rb"(?mi)^comment\s+TextureFile\s+([^\r\n]+)")
_MOST_PROPERTIES = 1000
_NO_NUMBER = re.compile(rb"(?i)(?<![\w.])[-+]?(?:\d\.?#\w+|nan(?:\(\w*\))?|inf(?:inity)?)(?![\w.])")
_DECIMAL_COMMA = re.compile(rb"(?<=\d),(?=\d)")


@dataclass(frozen=True)
class Lists:
    """A list property: the length of each row's list, and the values of all lists, concatenated."""

    count: npt.NDArray[np.int64]  # (N,)
    values: Array  # (sum of the counts,)

    @property
    def offsets(self) -> npt.NDArray[np.int64]:
        """Returns (N,) the index in `values` of each row's first value."""
        return np.cumsum(self.count) - self.count


@dataclass(frozen=True)
class Element:
    """The N rows of one PLY element: scalar properties as arrays (N,), list properties as lists; both by lower-case names."""

    name: str
    count: int
    columns: dict[str, Array]
    lists: dict[str, Lists]


@dataclass(frozen=True)
class _Property:
    name: str
    kind: str
    count: str | None  # dtype of a list's length; None for scalars


_Declared = list[tuple[str, int, list[_Property]]]  # name, count and properties of each element


def textures_of(data: bytes) -> list[str]:
    """Returns the image files named in a file's comments, in order."""
    return [decoded(name).strip() for name in _TEXTURE.findall(as_utf8(data[:_MOST_HEADER]).partition(b"end_header")[0])]


def elements(data: bytes, file: str, warn: Callable[[str], None] = lambda _: None) -> list[Element]:
    """Returns a file's elements, in order. Raises SceneError if the file is damaged."""
    data = data if data.startswith(b"ply") else as_utf8(data)
    header = _HEADER.match(data[:_MOST_HEADER])
    if header is None:
        raise SceneError(
            Sentence(
                "ply-header-missing",
                "{file} is damaged or not a .ply file. Export it again (its header is incomplete)",
                file=file,
            )
        )
    way, declared = _declared(header[0].decode("ascii", "replace"), file)
    rows: _Text | _Bytes
    if way == "ascii":
        return _parse_text(data[header.end() :], declared, file, warn)
    if way in _ORDERS:
        rows = _Bytes(data, header.end(), _ORDERS[way], file)
    else:
        raise SceneError(
            Sentence(
                "ply-format-unknown",
                "{file} is a .ply file of format {format}; export it as binary or ascii",
                file=file,
                format=repr(way[:40]),
            )
        )
    return [Element(name, count, *rows.read_element(name, count, properties)) for name, count, properties in declared]


def _declared(header: str, file: str) -> tuple[str, _Declared]:
    way, found = "", list[tuple[str, int, list[_Property]]]()
    for line in header.splitlines():
        words = line.split()
        if words[:1] == ["format"] and len(words) > 1:
            way = words[1]
        elif words[:1] == ["element"] and len(words) == 3 and words[2].isdigit() and len(words[2]) < 16:
            found.append((words[1].lower(), int(words[2]), []))
        elif words[:1] == ["property"] and found and _is_property(words):
            is_list = words[1] == "list"
            found[-1][2].append(_Property(words[-1].lower(), _TYPES[words[-2]], _TYPES[words[2]] if is_list else None))
        elif words[:1] in (["element"], ["property"]):
            raise SceneError(
                Sentence(
                    "ply-header-line-unknown",
                    "{file}: its header has an unknown line {line}; export it again",
                    file=file,
                    line=repr(line.strip()[:60]),
                )
            )
    if max((len(properties) for _, _, properties in found), default=0) > _MOST_PROPERTIES:
        raise SceneError(
            Sentence(
                "ply-properties-too-many",
                "{file} has rows with more than {most} properties; export it with fewer",
                file=file,
                most=_MOST_PROPERTIES,
            )
        )
    return way, found


def _is_property(words: list[str]) -> bool:
    if len(words) == 5:
        return words[1] == "list" and words[2] in _TYPES and words[3] in _TYPES and _TYPES[words[2]][0] != "f"
    return len(words) == 3 and words[1] in _TYPES


def _truncated_error(file: str, element: str) -> SceneError:
    return SceneError(
        Sentence(
            "ply-file-cut-off",
            "{file} ends within its {element} rows, or has damaged ones; the upload or download was interrupted, repeat it",
            file=file,
            element=element[:40],
        )
    )


def _parse_text(text: bytes, declared: _Declared, file: str, warn: Callable[[str], None]) -> list[Element]:
    """Returns the elements of a text file.

    The text is read as one stream of numbers regardless of line ends, unless rows have surplus numbers.
    """
    text = _NO_NUMBER.sub(b" nan ", text) if b"#" in text or b"(" in text else text
    commas = 0
    if b"," in text:
        text, commas = _DECIMAL_COMMA.subn(b".", text)
    if commas:
        warn(
            Sentence(
                "mesh-decimal-commas",
                "{file}: {count} numbers have decimal commas, which are read as points.",
                file=file,
                count=commas,
            )
        )
    rows = _Text(text, file)
    try:
        found = [Element(name, count, *rows.read_element(name, count, properties)) for name, count, properties in declared]
        if rows.is_done:
            return found
    except SceneError:
        found = []
    trimmed, longer = _drop_surplus_numbers(text.splitlines(), declared)
    if not longer:
        if not found:
            raise _truncated_error(file, next((name for name, count, _ in declared if count), "vertex"))
        return found
    warn(
        Sentence(
            "ply-row-numbers-dropped",
            "{file}: {count} rows have more numbers than the header declares; these are left out.",
            file=file,
            count=longer,
        )
    )
    rows = _Text(trimmed, file)
    return [Element(name, count, *rows.read_element(name, count, properties)) for name, count, properties in declared]


def _drop_surplus_numbers(lines: list[bytes], declared: _Declared) -> tuple[bytes, int]:
    """Returns a text with only the declared numbers of each line, and the number of lines that had surplus ones.

    Returns (b"", 0) if a line does not correspond to one row.
    """
    numbers, longer = list[bytes](), 0
    rows = (line.split() for line in lines if line.strip())
    try:
        for _, count, properties in declared:
            for _ in range(count):
                words = next(rows)
                at = 0
                for each in properties:
                    at += 1 if each.count is None else 1 + int(words[at])
                if at > len(words):
                    return b"", 0
                longer += at < len(words)
                numbers += words[:at]
    except (StopIteration, IndexError, ValueError):
        return b"", 0
    return b" ".join(numbers), longer


class _Bytes:
    """Reads the rows of a binary file, element by element."""

    def __init__(self, data: bytes, at: int, order: str, file: str) -> None:
        self._data, self._at, self._order, self._file = data, at, order, file

    def read_element(self, name: str, count: int, properties: list[_Property]) -> tuple[dict[str, Array], dict[str, Lists]]:
        """Returns the columns and lists of the next element. name: of the element, for errors; count: number of rows."""
        if not count or not properties:
            return _columns(np.zeros(0, self._kind(properties, [])), properties, {})
        counts = self._first_counts(name, properties)
        kind = self._kind(properties, counts)
        if kind.itemsize * count <= len(self._data) - self._at:
            rows = np.frombuffer(self._data, kind, count, self._at)
            if all((rows[f"{i} count"] == known).all() for i, known in counts):
                self._at += kind.itemsize * count
                return _columns(rows, properties, dict(counts))
        if not counts:
            raise _truncated_error(self._file, name)
        return self._read_ragged_rows(name, count, properties)

    def _first_counts(self, name: str, properties: list[_Property]) -> list[tuple[int, int]]:
        """Returns (property index, length) of each list in the first row."""
        found, at = [], self._at
        for i, each in enumerate(properties):
            if each.count is not None:
                length = self._length(name, at, np.dtype(each.count), np.dtype(each.kind).itemsize)
                found.append((i, length))
                at += np.dtype(each.count).itemsize + length * np.dtype(each.kind).itemsize
            else:
                at += np.dtype(each.kind).itemsize
        return found

    def _length(self, name: str, at: int, kind: np.dtype[Any], size: int) -> int:
        end = at + kind.itemsize
        order = "little" if self._order == "<" else "big"
        length = int.from_bytes(self._data[at:end], order, signed=kind.kind == "i")  # type: ignore[arg-type]
        if end > len(self._data) or not 0 <= length * size <= len(self._data) - end:
            raise _truncated_error(self._file, name)
        return length

    def _kind(self, properties: list[_Property], counts: list[tuple[int, int]]) -> np.dtype[Any]:
        """Returns the dtype of rows whose lists have the given lengths. counts: (property index, length) pairs."""
        lengths, fields = dict(counts), list[Any]()
        for i, each in enumerate(properties):
            if each.count is not None:
                fields.append((f"{i} count", self._order + each.count))
            fields.append((f"{i}", self._order + each.kind, *([(lengths.get(i, 0),)] if each.count is not None else [])))
        return np.dtype(fields)

    def _read_ragged_rows(self, name: str, count: int, properties: list[_Property]) -> tuple[dict[str, Array], dict[str, Lists]]:
        """Returns the columns and lists of an element whose rows have lists of different lengths."""
        if count > len(self._data) - self._at:
            raise _truncated_error(self._file, name)
        at, end = self._at, len(self._data)
        sizes = [(np.dtype(p.kind).itemsize, None if p.count is None else np.dtype(p.count)) for p in properties]
        places: list[list[int]] = [[] for _ in properties]
        lengths: list[list[int]] = [[] for _ in properties]
        for _ in range(count):
            for k, (size, counted) in enumerate(sizes):
                length = 1
                if counted is not None:
                    length = self._data[at] if counted.itemsize == 1 and at < end else self._length(name, at, counted, size)
                    at += counted.itemsize
                    lengths[k].append(length)
                places[k].append(at)
                at += size * length
            if at > end:
                raise _truncated_error(self._file, name)
        self._at = at
        columns, lists = dict[str, Array](), dict[str, Lists]()
        for each, begin, many in zip(properties, places, lengths, strict=True):
            kind = np.dtype(self._order + each.kind)
            number = np.array(many if each.count is not None else [1] * count, np.int64)
            step = np.arange(int(number.sum())) - np.repeat(np.cumsum(number) - number, number)
            byte = np.repeat(np.array(begin, np.int64), number) + step * kind.itemsize
            whole = np.frombuffer(self._data, np.uint8)
            values = np.ascontiguousarray(whole[byte[:, None] + np.arange(kind.itemsize)]).view(kind)[:, 0]
            if each.count is None:
                columns[each.name] = values
            else:
                lists[each.name] = Lists(number, values)
        return columns, lists


class _Text:
    """Reads the rows of a text file, element by element, as one stream of numbers regardless of line ends."""

    def __init__(self, text: bytes, file: str) -> None:
        self._file, self._at = file, 0
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                self._numbers = np.fromstring(text, np.float64, sep=" ")
            except (ValueError, DeprecationWarning):
                raise SceneError(
                    Sentence(
                        "ply-words-among-numbers",
                        "{file} is damaged or not a .ply file. Export it again (it contains words among its numbers)",
                        file=file,
                    )
                ) from None

    @property
    def is_done(self) -> bool:
        """True if all numbers of the file have been read."""
        return self._at == len(self._numbers)

    def read_element(self, name: str, count: int, properties: list[_Property]) -> tuple[dict[str, Array], dict[str, Lists]]:
        """Returns the columns and lists of the next element. name: of the element, for errors; count: number of rows."""
        left = self._numbers[self._at :]
        if count * len(properties) > len(left):
            raise _truncated_error(self._file, name)
        lengths = dict[int, int]()
        width = 0
        for i, each in enumerate(properties):
            if each.count is not None and count:
                lengths[i] = self._length(name, width)
                width += lengths[i]
            width += 1
        if count * width > len(left):
            return self._read_ragged_rows(name, count, properties)
        rows = left[: count * width].reshape(count, width)
        columns, lists = dict[str, Array](), dict[str, Lists]()
        at = 0
        for i, each in enumerate(properties):
            if each.count is None:
                columns[each.name] = rows[:, at].astype(each.kind if each.kind[0] != "f" else "f8")
                at += 1
                continue
            length = lengths.get(i, 0)
            if count and (rows[:, at] != length).any():
                return self._read_ragged_rows(name, count, properties)
            lists[each.name] = Lists(np.full(count, length), rows[:, at + 1 : at + 1 + length].reshape(-1))
            at += 1 + length
        self._at += count * width
        return columns, lists

    def _length(self, name: str, ahead: int) -> int:
        at = self._at + ahead
        length = self._numbers[at] if at < len(self._numbers) else -1.0
        if not 0 <= length <= len(self._numbers) - at - 1:
            raise _truncated_error(self._file, name)
        return int(length)

    def _read_ragged_rows(self, name: str, count: int, properties: list[_Property]) -> tuple[dict[str, Array], dict[str, Lists]]:
        begin = self._at
        places: list[list[int]] = [[] for _ in properties]
        lengths: list[list[int]] = [[] for _ in properties]
        for _ in range(count):
            for k, each in enumerate(properties):
                length = 1
                if each.count is not None:
                    length = self._length(name, 0)
                    self._at += 1
                places[k].append(self._at)
                lengths[k].append(length)
                self._at += length
        if self._at > len(self._numbers):
            self._at = begin
            raise _truncated_error(self._file, name)
        columns, lists = dict[str, Array](), dict[str, Lists]()
        for each, first, many in zip(properties, places, lengths, strict=True):
            number = np.array(many, np.int64)
            step = np.arange(int(number.sum())) - np.repeat(np.cumsum(number) - number, number)
            values = self._numbers[np.repeat(np.array(first, np.int64), number) + step]
            if each.count is None:
                columns[each.name] = values.astype(each.kind if each.kind[0] != "f" else "f8")
            else:
                lists[each.name] = Lists(number, values)
        return columns, lists


def _columns(rows: Array, properties: list[_Property], lengths: dict[int, int]) -> tuple[dict[str, Array], dict[str, Lists]]:
    columns = {each.name: rows[f"{i}"] for i, each in enumerate(properties) if each.count is None}
    lists = {
        each.name: Lists(np.full(len(rows), lengths.get(i, 0)), rows[f"{i}"].reshape(-1))
        for i, each in enumerate(properties)
        if each.count is not None
    }
    return columns, lists
