"""Text of files in whatever encoding: marked by a BOM, UTF-8, or else one that names of files reveal.

Bytes that are not UTF-8 are kept as lone surrogates (PEP 383), so that names that differ in bytes differ as strings, and
`SceneFiles.find` can try the encodings of the world until one finds the file. `names.readable` turns what is left into text.
"""

from __future__ import annotations

import codecs
import re

__all__ = ["as_utf8", "decoded", "with_points"]

_BOMS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_DECIMAL_COMMA = re.compile(r"(?<=\d),(?=\d)")
_SAMPLE = 4096  # bytes, of which half are 0 in UTF-16 of western text


def decoded(data: bytes) -> str:
    """The text of a file, without its BOM; bytes that are not UTF-8 as lone surrogates."""
    for bom, encoding in _BOMS:
        if data.startswith(bom):
            if encoding == "utf-8":
                return data[len(bom) :].decode("utf-8", "surrogateescape")
            return data.decode(encoding, "replace")
    if (wide := _unmarked_utf16(data)) is not None:
        return data.decode(wide, "replace")
    return data.decode("utf-8", "surrogateescape")


def as_utf8(data: bytes) -> bytes:
    """The text of a file in UTF-8, without its BOM; bytes that are not UTF-8 stay."""
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


def with_points(text: str) -> tuple[str, int]:
    """A text of numbers with points in place of decimal commas, and how many there were."""
    return _DECIMAL_COMMA.subn(".", text) if "," in text else (text, 0)
