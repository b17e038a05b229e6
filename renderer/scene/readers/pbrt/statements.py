"""Parses a pbrt file and its includes into statements: a directive with its arguments.

Long lists of numbers, the bulk of large files, are parsed in one call rather than token by token.
"""

from __future__ import annotations

import re
import warnings
import zlib
from collections.abc import Iterator
from pathlib import PurePosixPath
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.library_messages import library_message
from renderer.scene.files import MAX_FILE_BYTES, SceneFiles
from renderer.scene.readers.pbrt.notes import Place
from renderer.scene.text_encoding import decoded
from renderer.sentences import Sentence
from renderer.zips import most_unpacked

__all__ = ["MAX_DEPTH", "MAX_STATEMENTS", "Argument", "Statement", "Statements", "unpacked"]

Argument = str | npt.NDArray[np.float64] | tuple[str, ...] | tuple[bool, ...]  # a quoted string, or a list

MAX_DEPTH = 32  # of nested includes
MAX_FILES = 20_000
MAX_STATEMENTS = 5_000_000
MAX_TEXT = 2 << 30  # bytes of all files together
MAX_AGAIN = 16 << 20  # bytes of files included repeatedly
_TOKEN = re.compile(r'\s+|#[^\n]*|"(?P<text>[^"\n]*)"|(?P<open>\[)|(?P<word>[^\s"\[\]#]+)')
_LIST = re.compile(r'(?:[^"\]#]+|"[^"\n]*"|#[^\n]*)*+\]')
_COMMENT = re.compile(r'("[^"\n]*")|#[^\n]*')
_QUOTED = re.compile(r'"([^"\n]*)"')
_LONG = 2000  # characters; longer lists are parsed as a whole
_TRUTHS = {"true": True, "false": False}


class Statement(NamedTuple):
    """A directive with its arguments, and its position in the file."""

    directive: str
    arguments: list[Argument]
    place: Place


class Statements:
    """Parses files into statements. Raises SceneError, with the line, for a syntax error."""

    def __init__(self, files: SceneFiles) -> None:
        self._files = files
        self._count = self._bytes = self._opened = self._again = 0
        self._seen: set[str] = set()

    def statements_of(self, name: str, depth: int = 0) -> Iterator[Statement]:
        """Yields the statements of a file; Include and Import are yielded, not followed. depth: nesting level of the file."""
        if depth > MAX_DEPTH:
            raise SceneError(
                Sentence(
                    "pbrt-includes-too-deep",
                    "{name} is included at a depth of {depth} files; do files include each other?",
                    name=name,
                    depth=MAX_DEPTH,
                )
            )
        self._opened += 1
        if self._opened > MAX_FILES:
            raise SceneError(
                Sentence(
                    "pbrt-includes-too-many",
                    "{name}: more than {most} files are included; merge some",
                    name=name,
                    most=MAX_FILES,
                )
            )
        data = self._files.read(name)
        if name.lower().endswith(".gz"):
            data = unpacked(data, name)
        self._bytes += len(data)
        if self._bytes > MAX_TEXT:
            raise SceneError(
                Sentence(
                    "pbrt-text-too-large",
                    "{name}: with it the scene has more than {most_gib} GiB of text; make it smaller",
                    name=name,
                    most_gib=MAX_TEXT >> 30,
                )
            )
        if name in self._seen:
            self._again += len(data)
        if self._again > MAX_AGAIN:
            raise SceneError(
                Sentence(
                    "pbrt-includes-repeated-too-large",
                    "{name}: repeated includes come to more than {most_mib} MiB; make an object of what is "
                    "shown many times (ObjectBegin)",
                    name=name,
                    most_mib=MAX_AGAIN >> 20,
                )
            )
        self._seen.add(name)
        yield from self._parsed(decoded(data), PurePosixPath(name).name)

    def _parsed(self, text: str, file: str) -> Iterator[Statement]:
        directive, arguments, place = "", list[Argument](), Place(file, 1)
        at, line, counted = 0, 1, 0
        while at < len(text):
            found = _TOKEN.match(text, at)
            if found is None:
                line += text.count("\n", counted, at)
                raise Place(file, line).error(
                    Sentence(
                        "pbrt-token-unknown",
                        "{text} is not valid pbrt syntax; correct it",
                        text=repr(text[at : at + 20]),
                    )
                )
            end = found.end()
            word = found["word"]
            if word is not None and word not in _TRUTHS and not _starts_number(word):
                if directive:
                    yield self._check_count(Statement(directive, arguments, place))
                line, counted = line + text.count("\n", counted, at), at
                directive, arguments, place = word, [], Place(file, line)
            elif found.lastgroup is not None:
                if not directive:
                    raise place.error(
                        Sentence(
                            "pbrt-directive-expected",
                            "begins with {text} in place of a directive; is it a pbrt scene?",
                            text=repr(text[at : at + 20]),
                        )
                    )
                if found["open"] is not None:
                    value, end = _parse_list(text, end, place)
                    arguments.append(value)
                else:
                    arguments.append(found["text"] if word is None else _parse_value(word, place))
            at = end
        if directive:
            yield self._check_count(Statement(directive, arguments, place))

    def _check_count(self, statement: Statement) -> Statement:
        self._count += 1
        if self._count > MAX_STATEMENTS:
            raise statement.place.error(
                Sentence(
                    "pbrt-statements-too-many",
                    "there are more than {million} million statements; make the scene smaller",
                    million=MAX_STATEMENTS // 10**6,
                )
            )
        return statement


def unpacked(data: bytes, name: str) -> bytes:
    """Returns the decompressed content of a .gz file. Raises SceneError if it is damaged or too large."""
    packed = zlib.decompressobj(wbits=31)
    most = min(most_unpacked(len(data)), MAX_FILE_BYTES)
    try:
        found = packed.decompress(data, most)
    except zlib.error as error:
        raise SceneError(
            Sentence(
                "pbrt-gzip-damaged",
                "{name}: could not be unpacked ({error}); pack it again",
                name=name,
                error=library_message(error),
            )
        ) from None
    if not packed.eof:
        raise SceneError(
            Sentence(
                "pbrt-gzip-bomb",
                "{name}: unpacks to more than {most} MiB, as zip bombs do; split it",
                name=name,
                most=most >> 20,
            )
            if len(found) >= most
            else Sentence("pbrt-gzip-cut-off", "{name} is cut off; pack it again", name=name)
        )
    return found


def _starts_number(word: str) -> bool:
    return word[0].isdigit() or word[0] in "+-."


def _parse_value(word: str, place: Place) -> Argument:
    return (_TRUTHS[word],) if word in _TRUTHS else _numbers([word], place)


def _parse_list(text: str, start: int, place: Place) -> tuple[Argument, int]:
    """Parses a list in brackets. Returns its values, and the index after its closing bracket.

    start: index after the opening bracket.
    """
    end = text.find("]", start)
    inside = text[start:end]
    if '"' in inside or "#" in inside:  # brackets in quotes or comments do not count
        whole = _LIST.match(text, start)
        end = whole.end() - 1 if whole is not None else -1
        inside = text[start:end]
    if end < 0:
        raise place.error(Sentence("pbrt-list-not-closed", "a list in brackets is not closed; close it with ]"))
    if "#" in inside:
        inside = _COMMENT.sub(lambda found: found[1] or "", inside)
    if '"' in inside:
        return tuple(_QUOTED.findall(inside)), end + 1
    if len(inside) > _LONG and (quick := _parse_numbers(inside)) is not None:
        return _finite(quick, place), end + 1
    words = inside.split()
    if words and words[0] in _TRUTHS:
        if any(word not in _TRUTHS for word in words):
            raise place.error(
                Sentence("pbrt-booleans-malformed", "{text} are neither numbers nor true and false", text=repr(inside[:40]))
            )
        return tuple(_TRUTHS[word] for word in words), end + 1
    return _numbers(words, place), end + 1


def _numbers(words: list[str], place: Place) -> npt.NDArray[np.float64]:
    try:
        found: npt.NDArray[Any] = np.array(words, np.float64)
    except ValueError:
        odd = next((word for word in words if not _is_number(word)), "")
        raise place.error(Sentence("pbrt-number-malformed", "{text} is not a number; correct it", text=repr(odd[:40]))) from None
    return _finite(found, place)


def _parse_numbers(text: str) -> npt.NDArray[np.float64] | None:
    """Returns an array of whitespace-separated numbers; None if the text contains anything else."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return np.fromstring(text, np.float64, sep=" ")
        except (ValueError, DeprecationWarning):
            return None


def _finite(found: npt.NDArray[np.float64], place: Place) -> npt.NDArray[np.float64]:
    if not np.isfinite(found).all():
        raise place.error(Sentence("pbrt-number-not-finite", "a number is infinite or NaN; correct it"))
    return found


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
