"""Decodes the names of a zip's entries: normalises separators to slashes and detects the encoding.

Sources: APPNOTE.TXT 4.4.4 (bit 11: UTF-8), 4.6.9 (Info-ZIP's Unicode path). A name with neither is in the encoding of the packing
system, which is not recorded. Then the chosen encoding is the one in which the archive's scene files refer to the names, else the
first that yields words.
"""

from __future__ import annotations

import contextlib
import struct
import unicodedata
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from pathlib import PurePosixPath
from typing import NamedTuple

from renderer.formats import NAMING_SUFFIXES
from renderer.sentences import Sentence
from renderer.zips import DAMAGED

__all__ = ["EntryNames", "entry_names"]

_UTF8_FLAG = 0x800
_UNICODE_PATH = 0x7075
# Encodings in order of preference; an undefined byte excludes one. An umlaut in CP437 and the letter after it
# are a rare character in GBK.
_ENCODINGS = ("utf-8", "gb2312", "cp932", "cp437", "gb18030", "big5", "cp949", "cp1252", "cp1251")
_PLAIN = "cp437"  # the default by the format's specification
_TITLES = {"gb2312": "GBK", "gb18030": "GBK", "cp932": "Shift-JIS", "big5": "Big5", "cp949": "EUC-KR"}
_FIRST_OF_EAST_ASIA = 0x2E80
_MOST_FILES, _MOST_BYTES = 16, 1 << 18  # limits of scene files that are searched


class EntryNames(NamedTuple):
    """The decoded names of the entries, in order, and a sentence for the user if the encoding of some was guessed."""

    names: list[str]
    guess: str | None


def entry_names(archive: zipfile.ZipFile, entries: Sequence[zipfile.ZipInfo]) -> EntryNames:
    """Decodes the names of some entries of an archive."""
    found: list[str | None] = []
    unknown: list[bytes] = []
    for entry in entries:
        name = _declared_name(entry)
        found.append(name)
        if name is None:
            unknown.append(_raw_name(entry))
    guess = None
    if unknown:
        encoding = _encoding(unknown, archive, entries)
        decoded = iter([raw.decode(encoding, "replace") for raw in unknown])
        found = [next(decoded) if name is None else name for name in found]
        title = _TITLES.get(encoding, encoding.upper())
        guess = Sentence(
            "archive-name-encoding-guessed",
            "The archive does not state the encoding of {count} names; they are read as {encoding}.",
            count=len(unknown),
            encoding=title,
        )
        if encoding == "utf-8":
            guess = None
    return EntryNames([(name or "").replace("\\", "/") for name in found], guess)


def _raw_name(entry: zipfile.ZipInfo) -> bytes:
    return entry.orig_filename.encode("cp437")


def _declared_name(entry: zipfile.ZipInfo) -> str | None:
    """Returns an entry's name if it is ASCII or the archive declares its encoding; else None."""
    name = entry.orig_filename
    if name.isascii() or entry.flag_bits & _UTF8_FLAG:
        return name
    extra = entry.extra
    with contextlib.suppress(struct.error, UnicodeDecodeError):
        while len(extra) >= 4:
            kind, size = struct.unpack("<HH", extra[:4])
            field, extra = extra[4 : 4 + size], extra[4 + size :]
            if kind == _UNICODE_PATH and len(field) > 5:
                version, crc = struct.unpack("<BI", field[:5])
                if version == 1 and crc == zlib.crc32(_raw_name(entry)):
                    return field[5:].decode("utf-8")
    return None


def _encoding(names: list[bytes], archive: zipfile.ZipFile, entries: Sequence[zipfile.ZipInfo]) -> str:
    possible = {encoding: decoded for encoding in _ENCODINGS if (decoded := _decoded(names, encoding)) is not None}
    if "utf-8" in possible:
        return "utf-8"
    texts = list(_texts(archive, entries))
    for encoding, decoded in possible.items():
        bare = {PurePosixPath(name.replace("\\", "/")).name for name in decoded}
        bare = {name for name in bare if not name.isascii()}
        forms = {form for name in bare for form in (unicodedata.normalize("NFC", name), unicodedata.normalize("NFD", name))}
        spelled = [form.encode() for form in forms]
        if any(name in text for text in texts for name in spelled):
            return encoding
    return next((encoding for encoding, decoded in possible.items() if _are_words(decoded, encoding)), _PLAIN)


def _decoded(names: list[bytes], encoding: str) -> list[str] | None:
    try:
        return [name.decode(encoding) for name in names]
    except UnicodeDecodeError:
        return None


def _are_words(names: list[str], encoding: str) -> bool:
    """Returns True if all letters of the names are ones that users of this encoding commonly use in file names."""
    letters = [letter for name in names for letter in name if not letter.isascii()]
    if encoding in ("gb2312", "cp932", "gb18030", "big5", "cp949"):
        return all(letter.isalpha() and ord(letter) >= _FIRST_OF_EAST_ASIA for letter in letters)
    return all(letter.isalpha() for letter in letters)


def _texts(archive: zipfile.ZipFile, entries: Sequence[zipfile.ZipInfo]) -> Iterator[bytes]:
    """Yields the contents of the archive's scene and material files that can be read quickly."""
    naming = [entry for entry in entries if entry.filename.lower().endswith(NAMING_SUFFIXES)]
    quick = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
    for entry in [each for each in naming if each.compress_type in quick and not each.flag_bits & 1][:_MOST_FILES]:
        with contextlib.suppress(*DAMAGED, OSError), archive.open(entry) as source:
            yield source.read(_MOST_BYTES)
