"""Binary layouts, each declared once: the fields of a record in order, little-endian, without padding.

A record is a NamedTuple; each annotation contains the field's type and meaning. The encoder and decoder here, and the page's
decoders (protocol/generate.py), are derived from it.
"""

from __future__ import annotations

import struct
from typing import Any, Generic, NamedTuple, TypeVar, get_type_hints

__all__ = ["F32", "I64", "U8", "U16", "U32", "Field", "Kind", "Layout"]


class Kind(NamedTuple):
    """Numeric type of a field. name: as in the documentation, such as "u8". code: as in the module `struct`."""

    name: str
    code: str


U8, U16, U32, I64, F32 = Kind("u8", "B"), Kind("u16", "H"), Kind("u32", "I"), Kind("i64", "q"), Kind("f32", "f")


class Field(NamedTuple):
    """One field of a binary layout. at: offset from the record's start, in bytes. meaning: text for the documentation."""

    name: str
    kind: Kind
    at: int
    meaning: str


R = TypeVar("R", bound=NamedTuple)


class Layout(Generic[R]):
    """The binary layout of a record. row: the NamedTuple class whose fields it has.

    If version and kind are given, they are the first two bytes of each record.
    """

    def __init__(self, name: str, row: type[R], version: int | None = None, kind: int | None = None) -> None:
        self.name = name
        self.row = row
        self.version = version
        self.kind = kind
        self._mark = b"" if version is None or kind is None else bytes([version, kind])
        hints: dict[str, Any] = get_type_hints(row, include_extras=True)
        fields, codes = [], ""
        for field in row._fields:
            of, meaning = hints[field].__metadata__
            fields.append(Field(field, of, len(self._mark) + struct.calcsize(f"<{codes}"), meaning))
            codes += of.code
        self.fields = tuple(fields)
        self._struct = struct.Struct(f"<{codes}")
        self.size = len(self._mark) + self._struct.size

    @property
    def text(self) -> str:
        """Returns the fields in the notation of the documentation: "u8 version = 1, u8 kind = 2, u16 w, u16 h"."""
        mark = [] if self.version is None else [f"u8 version = {self.version}", f"u8 kind = {self.kind}"]
        return ", ".join([*mark, *(f"{field.kind.name} {field.name}" for field in self.fields)])

    def pack(self, row: R) -> bytes:
        """Encodes a record. Raises struct.error if a value does not fit into its field."""
        return self._mark + self._struct.pack(*row)

    def unpack(self, data: bytes, at: int = 0) -> R:
        """Decodes the record at offset `at`. Raises ValueError if the data is truncated, or has another version or kind."""
        if len(data) < at + self.size:
            raise ValueError(f"a {self.name} of {len(data) - at} bytes is cut off")
        start = at + len(self._mark)
        if data[at:start] != self._mark:
            version, kind = data[at:start]
            raise ValueError(f"a packet of version {version} and kind {kind} is no {self.name} of version {self.version}")
        return self.row._make(self._struct.unpack_from(data, start))

    def unpack_all(self, data: bytes, at: int, count: int) -> list[R]:
        """Decodes `count` consecutive records of a layout without version. Raises ValueError if the data is truncated."""
        end = at + count * self.size
        if len(data) < end:
            raise ValueError(f"{count} times a {self.name} in {len(data) - at} bytes are cut off")
        return [self.row._make(values) for values in self._struct.iter_unpack(memoryview(data)[at:end])]
