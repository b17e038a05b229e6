"""Decodes text files of unknown encoding: by a BOM, as UTF-8, or in the encoding in which file names in the text exist.

Bytes that are not UTF-8 are stored as lone surrogates (PEP 383): names that differ in bytes then differ as strings, and
`SceneFiles.find` can try common encodings until one yields an existing file. `readable` converts the remaining ones to text.
"""

from __future__ import annotations

import codecs
import contextlib
import re
from collections.abc import Iterable, Iterator

__all__ = [
    "as_utf8",
    "decoded",
    "is_readable",
    "likely_encoding",
    "possible_decodings",
    "readable",
    "title",
    "with_decimal_points",
]

_BOMS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_ENCODINGS = ("gb18030", "cp932", "cp949", "big5", "cp1252", "cp1251", "cp437", "latin-1")
_TITLES = {"gb18030": "GBK", "cp932": "Shift-JIS", "cp949": "EUC-KR", "big5": "Big5", "latin-1": "Latin-1"}
# Patterns of names in one encoding that names in the others hardly ever match, each for the bytes above ASCII in succession.
_COMMON_HANZI = re.compile(rb"(?:[\xb0-\xd7][\xa1-\xfe])+")  # the 3,755 most common characters of GB 2312
_HANGUL = re.compile(rb"(?:[\xb0-\xc8][\xa1-\xfe])+")  # all syllables of EUC-KR, whose bytes are common hanzi, too
_KANA = re.compile(rb"\x82[\x9f-\xf1]|\x83[\x40-\x96]")
_CYRILLIC = re.compile(rb"[\xc0-\xff][\xe0-\xff]{2,}")
_ACCENTED = re.compile(rb"[\xc0-\xd6\xd8-\xf6\xf8-\xff]{1,2}")
_ABOVE_ASCII = re.compile(rb"[\x80-\xff]+")
_DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d)")
_SAMPLE = 4096  # bytes, of which half are 0 in UTF-16 of western text


def decoded(data: bytes) -> str:
    """Returns the text of a file, without its BOM; bytes that are not UTF-8 become lone surrogates."""
    for bom, encoding in _BOMS:
        if data.startswith(bom):
            if encoding == "utf-8":
                return data[len(bom) :].decode("utf-8", "surrogateescape")
            return data.decode(encoding, "replace")
    if (wide := _unmarked_utf16(data)) is not None:
        return data.decode(wide, "replace")
    return data.decode("utf-8", "surrogateescape")


def as_utf8(data: bytes) -> bytes:
    """Returns a file's text in UTF-8, without its BOM; bytes that are not UTF-8 are unchanged."""
    if data.startswith(codecs.BOM_UTF8):
        return data[len(codecs.BOM_UTF8) :]
    if data.startswith(tuple(bom for bom, _ in _BOMS)) or _unmarked_utf16(data) is not None:
        return decoded(data).encode("utf-8", "surrogateescape")
    return data


def _unmarked_utf16(data: bytes) -> str | None:
    sample = data[:_SAMPLE]
    if len(sample) < 8 or b"\0" not in sample:
        return None
    even, odd = sample[::2].count(0), sample[1::2].count(0)
    if odd > 0.4 * len(sample) and even == 0:
        return "utf-16-le"
    return "utf-16-be" if even > 0.4 * len(sample) and odd == 0 else None


def with_decimal_points(text: str) -> tuple[str, int]:
    """Returns a text with decimal commas replaced by points, and the number of replacements."""
    return _DECIMAL_COMMA.subn(".", text) if "," in text else (text, 0)


def title(encoding: str) -> str:
    """Returns the common name of an encoding, for messages."""
    return _TITLES.get(encoding, encoding.upper())


def is_readable(text: str) -> bool:
    """Returns True if a string has no lone surrogates, that is, was valid UTF-8."""
    return text.isascii() or not any("\udc80" <= letter <= "\udcff" for letter in text)


def possible_decodings(text: str) -> Iterator[tuple[str, str]]:
    """Yields possible decodings of a string with lone surrogates: (encoding, text)."""
    data = text.encode("utf-8", "surrogateescape")
    for encoding in _ENCODINGS:
        with contextlib.suppress(UnicodeDecodeError):
            yield encoding, data.decode(encoding)


def likely_encoding(names: Iterable[str]) -> str | None:
    """Returns the encoding that strings with lone surrogates are probably in, judged together; None: undecided."""
    data = [name.encode("utf-8", "surrogateescape") for name in names]
    runs = [run for each in data for run in _ABOVE_ASCII.findall(each)]
    if not runs:
        return None
    if any(_KANA.search(each) for each in data) and all(_is_in(each, "cp932") for each in data):
        return "cp932"
    for pattern, encoding in ((_ACCENTED, "cp1252"), (_COMMON_HANZI, "gb18030"), (_CYRILLIC, "cp1251")):
        if all(pattern.fullmatch(run) for run in runs):
            return None if encoding == "gb18030" and all(_HANGUL.fullmatch(run) for run in runs) else encoding
    return None


def _is_in(data: bytes, encoding: str) -> bool:
    try:
        data.decode(encoding)
    except UnicodeDecodeError:
        return False
    return True


def readable(text: str, encoding: str | None = None) -> str:
    """Returns a string with its lone surrogates decoded, in the given encoding if possible, else as Latin-1.

    Strings that differ in their bytes still differ.
    """
    if is_readable(text):
        return text
    data = text.encode("utf-8", "surrogateescape")
    if encoding is not None:
        with contextlib.suppress(UnicodeDecodeError):
            return data.decode(encoding)
    return data.decode("latin-1")
