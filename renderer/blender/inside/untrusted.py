"""A copy of a .blend file in which every path leads to a file that came with it, or nowhere.

Blender opens linked libraries, caches and fonts while it reads a file, by paths that whoever made the file chose. A .blend is a
dump of Blender's memory with a table that describes it (its "DNA"): so paths are found as what they are, long arrays of
characters, whatever holds them. Sources: Blender's doc/blender_file_format, BLO_readfile, DNA_genfile.
"""

from __future__ import annotations

import gzip
import struct
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any, NamedTuple

__all__ = ["DamagedError", "safe_copy"]

PIECE = 1 << 20
PATH = 700  # characters from which an array holds a path: 768 and 1024 in Blender
SHORT_PATH = 160  # and before 2.6, of what is known to have one
WITH_PATHS = ("Library", "Image", "VFont", "bSound", "MovieClip")
NO_PATHS = ("bNodeSocketValueString", "ID")
MOST_BLOCKS = 20_000_000
DEEPEST = 16


class DamagedError(Exception):
    """Why a file cannot be read, as a sentence's end."""


class _Form(NamedTuple):
    """How a file is laid out. order: of bytes, as struct says it. head: of a block's header."""

    order: str
    pointer: int
    head: struct.Struct
    is_large: bool


class _Block(NamedTuple):
    at: int
    size: int
    kind: int  # the number of its struct
    repeats: int


def safe_copy(source: Path, target: Path, resolve: Callable[[str], str], most_bytes: int) -> None:
    """Writes the copy, which is not compressed.

    resolve: what stands in place of a path. most_bytes: that it may have. Raises DamagedError; OSError.
    """
    with _unpacked(source) as file, target.open("w+b") as out:
        blocks, dna, form = _copied(file, out, most_bytes)
        paths = _Dna(dna, form).paths()
        for block in blocks:
            if block.kind in paths:
                _mend(out, block, *paths[block.kind], resolve)


def _unpacked(source: Path) -> Any:
    with source.open("rb") as file:
        magic = file.read(4)
    if magic[:2] == b"\x1f\x8b":
        return gzip.open(source)
    if magic == b"\x28\xb5\x2f\xfd":
        try:
            import zstandard
        except ImportError:
            raise DamagedError("is compressed, and this Blender's Python cannot unpack it: save it without Compress") from None
        unpacking = zstandard.ZstdDecompressor(max_window_size=1 << 28)
        return unpacking.stream_reader(source.open("rb"), read_across_frames=True, closefd=True)
    return source.open("rb")


def _copied(file: IO[bytes], out: IO[bytes], most: int) -> tuple[list[_Block], bytes, _Form]:
    """Copies all, and says where its blocks are, what describes them, and how it is laid out."""
    left = most

    def take(size: int) -> bytes:
        nonlocal left
        left -= size
        if left < 0:
            raise DamagedError(f"unpacks to more than the {most / 2**30:.1f} GiB that this worker grants one scene")
        found = bytearray()
        while len(found) < size:
            try:
                piece = file.read(min(size - len(found), PIECE))
            except (OSError, EOFError, ValueError) as error:
                raise DamagedError(f"cannot be unpacked ({error}); save it anew") from None
            except Exception as error:  # zstandard has errors of its own
                raise DamagedError(f"cannot be unpacked ({error}); save it anew") from None
            if not piece:
                raise DamagedError("ends too soon; copy or save it anew")
            found += piece
        out.write(found)
        return bytes(found)

    form = _form(take)
    blocks: list[_Block] = []
    dna = b""
    while len(blocks) < MOST_BLOCKS:
        fields = form.head.unpack(take(form.head.size))
        code, kind, size, count = (fields[i] for i in ((0, 1, 3, 4) if form.is_large else (0, 3, 1, 4)))
        if code == b"ENDB":
            break
        if size < 0 or count < 0 or size > left:
            raise DamagedError("is damaged, or unpacks to more than this worker grants one scene; save it anew")
        at = out.tell()
        if code == b"DNA1":
            dna = take(size)
            continue
        for first in range(0, size, PIECE):
            take(min(PIECE, size - first))
        blocks.append(_Block(at, size, kind, count))
    if not dna:
        raise DamagedError("has no description of what is in it; save it anew")
    return blocks, dna, form


def _form(take: Callable[[int], bytes]) -> _Form:
    """What the header says: of 12 bytes, or since Blender 5 of as many as it says itself."""
    start = take(12)
    if start[:7] != b"BLENDER":
        raise DamagedError("is no .blend file")
    if start[7:8].isdigit():
        size = int(start[7:9]) if start[7:9].isdigit() else 0
        if not 12 <= size <= 64 or start[9:12] != b"-01":
            raise DamagedError("is of a newer Blender than is known here; export glTF from it instead")
        if take(size - 12)[:1] != b"v":
            raise DamagedError("has bytes in an order that is not read")
        return _Form("<", 8, struct.Struct("<4siQqq"), True)
    order = ">" if start[8:9] == b"V" else "<"
    pointer = 4 if start[7:8] == b"_" else 8
    return _Form(order, pointer, struct.Struct(f"{order}4si{'I' if pointer == 4 else 'Q'}ii"), False)


class _Dna:
    """The structs of a file, by their numbers."""

    def __init__(self, data: bytes, form: _Form) -> None:
        """Raises DamagedError."""
        self._data, self._form, self._at = data, form, 4
        try:
            self._names = [name.decode("latin-1") for name in self._texts(b"NAME")]
            self._types = [name.decode("latin-1") for name in self._texts(b"TYPE")]
            self._part(b"TLEN")
            self._sizes = self._shorts(len(self._types))
            self._part(b"STRC")
            self._structs: list[tuple[int, list[tuple[int, int]]]] = []
            for _ in range(self._number()):
                kind, count = self._shorts(2)
                flat = self._shorts(2 * count)
                self._structs.append((kind, list(zip(flat[::2], flat[1::2], strict=True))))
            self._by_type = dict(self._structs)
        except (struct.error, IndexError, ValueError) as error:
            raise DamagedError(f"has a damaged description of what is in it ({error}); save it anew") from None

    def paths(self) -> dict[int, tuple[int, list[tuple[int, int]]]]:
        """By the numbers of structs that hold paths: their size, and where these are and how long. Raises DamagedError."""
        found = {}
        for number, (kind, _) in enumerate(self._structs):
            try:
                places = self._paths_of(kind, 0)
            except IndexError:
                raise DamagedError("has a damaged description of what is in it; save it anew") from None
            if places:
                found[number] = (self._sizes[kind], places)
        return found

    def _paths_of(self, kind: int, depth: int) -> list[tuple[int, int]]:
        owner = self._types[kind]
        if owner in NO_PATHS or depth > DEEPEST:
            return []
        found, at = [], 0
        least = SHORT_PATH if owner in WITH_PATHS else PATH
        for type_, name in self._by_type.get(kind, ()):
            text = self._names[name]
            count = 1
            for part in text.split("[")[1:]:
                count *= int(part.rstrip("]")) if part.rstrip("]").isdigit() else 1
            if text.startswith(("*", "(")):
                at += self._form.pointer * count
                continue
            size = self._sizes[type_]
            if self._types[type_] == "char":
                if count >= least:
                    found.append((at, count))
            elif type_ in self._by_type and type_ != kind and (within := self._paths_of(type_, depth + 1)):
                for each in range(min(count, 1000)):
                    found += [(at + each * size + place, length) for place, length in within]
            at += size * count
        return found

    def _texts(self, code: bytes) -> list[bytes]:
        self._part(code)
        found = []
        for _ in range(self._number()):
            end = self._data.index(b"\0", self._at)
            found.append(self._data[self._at : end])
            self._at = end + 1
        return found

    def _part(self, code: bytes) -> None:
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


def _mend(out: IO[bytes], block: _Block, size: int, places: list[tuple[int, int]], resolve: Callable[[str], str]) -> None:
    if size <= 0 or block.repeats * size > block.size or any(place + length > size for place, length in places):
        raise DamagedError("is damaged: what is in it is smaller than it says; save it anew")
    for each in range(block.size // size):
        for place, length in places:
            at = each * size + place
            out.seek(block.at + at)
            path = out.read(length).split(b"\0", 1)[0]
            if not path or path.startswith(b"<"):  # <builtin>
                continue
            new = resolve(path.decode("utf-8", "replace")).encode()
            out.seek(block.at + at)
            out.write(new[: length - 1].ljust(length, b"\0"))
