"""Copies a .blend file, replacing all paths by those of uploaded files or by non-existent ones.

While reading a file, Blender opens linked libraries, caches and fonts by paths that the file's author chose. A .blend is a dump
of Blender's memory with a table that describes it (its "DNA"), so paths are found as long character arrays in any struct. Paths
stored behind pointers are cleared. Nodes that import files, by paths that other nodes may compute, are changed to an undefined
type. Sources: Blender's doc/blender_file_format, BLO_readfile, DNA_genfile.
"""

from __future__ import annotations

import gzip
import mmap
import struct
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any, NamedTuple

from .sentences import Sentence

__all__ = ["DamagedError", "safe_copy"]

PIECE = 1 << 20
MAGIC = b"BLENDER"
SHORTEST = 12  # bytes of the header
PATH = 700  # least length of an array that holds a path: 768 and 1024 in Blender
SHORT_PATH = 160  # before 2.6, for fields known to hold a path
WITH_PATHS = ("Library", "Image", "VFont", "bSound", "MovieClip")
NO_PATHS = ("bNodeSocketValueString", "ID")
TO_PATHS = ("*filepath", "*directory", "*bake_directory", "*simulation_bake_directory")  # pointers to strings that are paths
IMPORTING = b"GeometryNodeImport"  # prefix of the types of importing nodes
LEFT_OUT = b"RayfarmLeftOut"
MOST_BLOCKS = 20_000_000
DEEPEST = 16


class DamagedError(Exception):
    """Raised for a file that cannot be read; the message is the end of a sentence that begins with the file's name."""


class _FileLayout(NamedTuple):
    """The layout of a .blend file. order: byte order as in `struct`. pointer: size in bytes. head: format of a block's header."""

    order: str
    pointer: int
    head: struct.Struct
    is_large: bool


class _FieldSpans(NamedTuple):
    """The (offset, length) of each field of a struct that must be replaced. size: of the struct, in bytes."""

    size: int
    paths: list[tuple[int, int]]
    pointers: list[tuple[int, int]]  # to paths
    types: list[tuple[int, int]]  # of nodes


class _Block(NamedTuple):
    at: int
    size: int
    kind: int  # the number of its struct
    repeats: int


def safe_copy(source: Path, target: Path, resolve: Callable[[str], str], most_bytes: int) -> None:
    """Writes an uncompressed copy of a .blend file with safe paths.

    resolve: returns the replacement of a path. most_bytes: maximum size of the copy. Raises DamagedError; OSError if a file
    cannot be opened.
    """
    with target.open("w+b") as out:
        _unpack(source, out, most_bytes)
        out.flush()
        with mmap.mmap(out.fileno(), 0) as data:
            blocks, dna, form = _blocks(data)
            places = _Dna(dna, form).fields_to_replace()
            for block in blocks:
                if block.kind in places:
                    _replace_paths(data, block, places[block.kind], resolve)


def _unpacked(source: Path) -> Any:
    with source.open("rb") as file:
        magic = file.read(4)
    if magic[:2] == b"\x1f\x8b":
        return gzip.open(source)
    if magic == b"\x28\xb5\x2f\xfd":
        try:
            import zstandard
        except ImportError:
            raise DamagedError(
                Sentence("blend-compressed", "is compressed, which this Blender's Python cannot unpack; save it without Compress")
            ) from None
        unpacking = zstandard.ZstdDecompressor(max_window_size=1 << 28)
        return unpacking.stream_reader(source.open("rb"), read_across_frames=True, closefd=True)
    return source.open("rb", buffering=0)


def _unpack(source: Path, out: IO[bytes], max_bytes: int) -> None:
    """Writes the file's decompressed content to `out`; an uncompressed file is copied. max_bytes: maximum size in bytes."""
    piece = memoryview(bytearray(PIECE))
    size = 0
    with _unpacked(source) as file:
        while True:
            try:
                taken = file.readinto(piece)
            except Exception as error:  # zlib and zstandard have errors of their own
                raise DamagedError(
                    Sentence("blend-unpack-error", "cannot be unpacked ({error}); save it again", error=error)
                ) from None
            if not taken:
                break
            if not size and bytes(piece[: min(taken, len(MAGIC))]) != MAGIC[:taken]:
                raise DamagedError(Sentence("blend-not-a-blend", "is not a .blend file"))
            size += taken
            if size > max_bytes:
                raise DamagedError(
                    Sentence(
                        "blend-unpacks-too-large",
                        "unpacks to more than {limit} GiB, the limit of this worker for one scene",
                        limit=f"{max_bytes / 2**30:.1f}",
                    )
                )
            out.write(piece[:taken])
    if size < SHORTEST:
        raise DamagedError(Sentence("blend-truncated", "is truncated; copy or save it again"))


def _blocks(data: mmap.mmap) -> tuple[list[_Block], bytes, _FileLayout]:
    """Returns (blocks of a .blend file, its DNA, its layout)."""
    form, at = _parse_header(data)
    blocks: list[_Block] = []
    dna = b""
    while len(blocks) < MOST_BLOCKS:
        if at + form.head.size > len(data):
            raise DamagedError(Sentence("blend-truncated", "is truncated; copy or save it again"))
        fields = form.head.unpack_from(data, at)
        code, kind, size, count = (fields[i] for i in ((0, 1, 3, 4) if form.is_large else (0, 3, 1, 4)))
        at += form.head.size
        if code == b"ENDB":
            break
        if size < 0 or count < 0:
            raise DamagedError(Sentence("blend-damaged", "is damaged; save it again"))
        if size > len(data) - at:
            raise DamagedError(Sentence("blend-truncated", "is truncated; copy or save it again"))
        if code == b"DNA1":
            dna = data[at : at + size]
        else:
            blocks.append(_Block(at, size, kind, count))
        at += size
    if not dna:
        raise DamagedError(Sentence("blend-without-dna", "contains no description of its data (DNA); save it again"))
    return blocks, dna, form


def _parse_header(data: mmap.mmap) -> tuple[_FileLayout, int]:
    """Parses a .blend file's header; returns (layout, size of the header in bytes: 12, or since Blender 5 as stated in it)."""
    start = data[:SHORTEST]
    if start[7:8].isdigit():
        size = int(start[7:9]) if start[7:9].isdigit() else 0
        if not 12 <= size <= 64 or start[9:12] != b"-01":
            raise DamagedError(Sentence("blend-too-new", "was saved by a newer Blender than is supported; export glTF instead"))
        if data[12:13] != b"v":
            raise DamagedError(
                Sentence("blend-byte-order", "has an unsupported byte order; save it again with a current Blender")
            )
        return _FileLayout("<", 8, struct.Struct("<4siQqq"), True), size
    order = ">" if start[8:9] == b"V" else "<"
    pointer = 4 if start[7:8] == b"_" else 8
    return _FileLayout(order, pointer, struct.Struct(f"{order}4si{'I' if pointer == 4 else 'Q'}ii"), False), SHORTEST


class _Dna:
    """The DNA of a .blend file (the table that describes its memory dump): its structs, by number."""

    def __init__(self, data: bytes, form: _FileLayout) -> None:
        """Parses the DNA. Raises DamagedError if it is malformed."""
        self._data, self._form, self._at = data, form, 4
        try:
            self._names = [name.decode("latin-1") for name in self._texts(b"NAME")]
            self._types = [name.decode("latin-1") for name in self._texts(b"TYPE")]
            self._skip_code(b"TLEN")
            self._sizes = self._shorts(len(self._types))
            self._skip_code(b"STRC")
            self._structs: list[tuple[int, list[tuple[int, int]]]] = []
            for _ in range(self._number()):
                kind, count = self._shorts(2)
                flat = self._shorts(2 * count)
                self._structs.append((kind, list(zip(flat[::2], flat[1::2], strict=True))))
            self._by_type = dict(self._structs)
        except (struct.error, IndexError, ValueError) as error:
            raise DamagedError(
                Sentence("blend-dna-error", "has a damaged description of its data (DNA: {error}); save it again", error=error)
            ) from None

    def fields_to_replace(self) -> dict[int, _FieldSpans]:
        """Returns struct number -> the fields to replace. Raises DamagedError if the DNA is inconsistent."""
        found = {}
        for number, (kind, _) in enumerate(self._structs):
            try:
                places = self._places_in(kind, 0)
            except IndexError:
                raise DamagedError(
                    Sentence("blend-dna-damaged", "has a damaged description of its data (DNA); save it again")
                ) from None
            if any(places[1:]):
                found[number] = places
        return found

    def _places_in(self, kind: int, depth: int) -> _FieldSpans:
        owner = self._types[kind]
        found, at = _FieldSpans(self._sizes[kind], [], [], []), 0
        if owner in NO_PATHS or depth > DEEPEST:
            return found
        least = SHORT_PATH if owner in WITH_PATHS else PATH
        for type_, name in self._by_type.get(kind, ()):
            text = self._names[name]
            count = 1
            for part in text.split("[")[1:]:
                count *= int(part.rstrip("]")) if part.rstrip("]").isdigit() else 1
            if text.startswith(("*", "(")):
                if self._types[type_] == "char" and text in TO_PATHS:
                    found.pointers.append((at, self._form.pointer * count))
                at += self._form.pointer * count
                continue
            size = self._sizes[type_]
            if self._types[type_] == "char":
                if count >= least:
                    found.paths.append((at, count))
                elif owner == "bNode" and text.startswith("idname["):
                    found.types.append((at, count))
            elif type_ in self._by_type and type_ != kind and any((within := self._places_in(type_, depth + 1))[1:]):
                for each in range(min(count, 1000)):
                    for mine, theirs in zip(found[1:], within[1:], strict=True):
                        mine += [(at + each * size + place, length) for place, length in theirs]
            at += size * count
        return found

    def _texts(self, code: bytes) -> list[bytes]:
        self._skip_code(code)
        found = []
        for _ in range(self._number()):
            end = self._data.index(b"\0", self._at)
            found.append(self._data[self._at : end])
            self._at = end + 1
        return found

    def _skip_code(self, code: bytes) -> None:
        self._at = (self._at + 3) & ~3
        if self._data[self._at : self._at + 4] != code:
            raise ValueError(code.decode())
        self._at += 4

    def _number(self) -> int:
        (number,) = struct.unpack_from(f"{self._form.order}i", self._data, self._at)
        self._at += 4
        return int(number)

    def _shorts(self, count: int) -> list[int]:
        found = struct.unpack_from(f"{self._form.order}{count}H", self._data, self._at)
        self._at += 2 * count
        return list(found)


def _replace_paths(data: mmap.mmap, block: _Block, places: _FieldSpans, resolve: Callable[[str], str]) -> None:
    size = places.size
    everywhere = [*places.paths, *places.pointers, *places.types]
    if size <= 0 or block.repeats * size > block.size or any(place + length > size for place, length in everywhere):
        raise DamagedError(
            Sentence("blend-block-too-short", "is damaged: a block is shorter than its header says; save it again")
        )

    def replace(place: int, length: int, new: Callable[[bytes], bytes]) -> None:
        old = data[place : place + length].split(b"\0", 1)[0]
        if (made := new(old)) != old:
            data[place : place + length] = made[: length - 1].ljust(length, b"\0")

    def resolved(path: bytes) -> bytes:
        return path if path in (b"", b"<builtin>") else resolve(path.decode("utf-8", "replace")).encode()

    for start in range(block.at, block.at + block.size // size * size, size):
        for place, length in places.paths:
            replace(start + place, length, resolved)
        for place, length in places.types:
            replace(start + place, length, lambda name: LEFT_OUT if name.startswith(IMPORTING) else name)
        for place, length in places.pointers:
            data[start + place : start + place + length] = bytes(length)
