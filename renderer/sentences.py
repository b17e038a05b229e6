"""Sentences for users with a stable code: errors, warnings, reasons.

A `Sentence` is the English text, a `str`, with the `code` and the `params` from which it was made. The page uses these to
translate it, and programs to identify it. Ordinary text operations return plain text without a code. To put a sentence into
another, make it a parameter: `Sentence("texture-left-out", "{error}; rendered without it.", error=error)`.

JSON contains the text in its field, and the codes in a separate one:
`{"error": "...", "codes": {"error": {"code", "params"}}}`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Mapping
from numbers import Integral
from typing import Any, Self, SupportsIndex, cast

__all__ = [
    "Sentence",
    "codes_of",
    "count_of",
    "decoded",
    "encoded",
    "first_items",
    "from_json",
    "from_text",
    "in_lower_case",
    "joined_faults",
    "joined_sentences",
    "reason_of",
    "to_json",
    "to_text",
    "with_count",
    "with_full_stop",
]

_PLACE = re.compile(r"\{(\w+)\}")
_BEGINS = '{"code": '
_CODE = re.compile(r"[a-z0-9]+(-[a-z0-9]+)*")
_CLOSING = ".;:,)"  # before these, a sentence in a place is written without its full stop
_DEEPEST = 6  # sentences in each other
_MOST_PARAMS = 30
_LONGEST = 20_000  # characters of one text
_MOST_LISTED = 1000
_LARGEST = 2.0**63


class Sentence(str):
    """English text with the code and the parameters from which it was made.

    code: words in kebab case; once released, it is never changed or used for another meaning. template: the text with `{name}`
    for parameters. params: numbers, texts, sentences, exceptions (their sentence), or lists of those, which are joined by commas.
    """

    __slots__ = ("code", "params")

    code: str
    params: dict[str, Any]

    def __new__(cls, code: str, template: str, /, **params: object) -> Self:
        """Creates the sentence from a template, with its `{name}` fields replaced by the parameters."""
        values = {name: _value(value) for name, value in params.items()}
        return cls._create(_filled(template, values), code, values)

    @classmethod
    def _create(cls, text: str, code: str, params: dict[str, Any]) -> Self:
        made = str.__new__(cls, text)
        made.code, made.params = code, params
        return made

    @classmethod
    def from_text(cls, sentence: str) -> Self:
        """Returns a text as a Sentence: the same one if it is a Sentence already, else one with an empty code."""
        if isinstance(sentence, Sentence):
            return cls._create(str.__str__(sentence), sentence.code, sentence.params)
        return cls._create(sentence, "", {})

    def __str__(self) -> str:
        return self  # so that str(exception) keeps the code

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (type(self), str.__str__(self), self.code, self.params)

    def __getitem__(self, key: SupportsIndex | slice, /) -> str:
        """Returns a part of the text, as plain text; if it is the whole text, the sentence with its code."""
        text = super().__getitem__(key)
        return self if text == self else text

    def removesuffix(self, suffix: str, /) -> str:
        """Returns the text without a suffix. The result keeps the code only if the suffix is the full stop."""
        text = super().removesuffix(suffix)
        return self._create(text, self.code, self.params) if suffix == "." else text

    def rstrip(self, chars: str | None = None, /) -> str:
        """Returns the text without trailing characters. The result keeps the code only for the full stop, and for white space."""
        text = super().rstrip(chars)
        return self._create(text, self.code, self.params) if chars in (".", None) else text

    def mapped(self, change: Callable[[str], str]) -> Self:
        """Returns the sentence with `change` applied to its text and to the texts among its parameters."""

        def map_value(value: Any) -> Any:
            if isinstance(value, Sentence):
                return value.mapped(change)
            if isinstance(value, list):
                return [map_value(each) for each in value]
            return change(value) if isinstance(value, str) else value

        params = {name: map_value(value) for name, value in self.params.items()}
        return self._create(change(str.__str__(self)), self.code, params)

    @property
    def coded(self) -> dict[str, Any]:
        """The code and the parameters as JSON. Sentences among the parameters include their text."""
        return {"code": self.code, "params": {name: to_json(value) for name, value in self.params.items()}}

    @classmethod
    def from_coded(cls, text: str, coded: Any) -> str:
        """Returns the sentence with this text and the code and parameters in `coded`; the plain text if `coded` is malformed."""
        try:
            return cls._create(text, *_parsed(coded, 0)) if len(str(coded)) <= 4 * _LONGEST else text
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
            return text


def joined_sentences(first: str, second: str) -> str:
    """Joins two sentences to one text; either may be empty."""
    if not first or not second:
        return str(first or second)
    return Sentence("sentences-joined", "{first} {second}", first=first, second=second)


def in_lower_case(text: str) -> str:
    """Returns a text with its first letter in lower case, for use within a sentence."""
    begun = text[:1].lower() + text[1:]
    return text._create(begun, text.code, text.params) if isinstance(text, Sentence) else begun


def with_full_stop(sentence: object) -> str:
    """Returns a sentence with a full stop appended, for sentences written without one, such as error messages about files."""
    return Sentence("sentence-closed", "{sentence}.", sentence=sentence)


def joined_faults(first: str, second: str) -> str:
    """Joins two error messages, written without a full stop, to one text."""
    return Sentence("faults-joined", "{first}; {second}", first=first, second=second)


def reason_of(sentence: str) -> str:
    """Returns the first part of an error message of the form "fault; consequence"."""
    if isinstance(sentence, Sentence) and "error" in sentence.params:
        return str(sentence.params["error"])
    return sentence.partition(";")[0]


def count_of(n: int, what: str) -> str:
    """Returns a count with its noun, such as "3 meshes", for use as a parameter. what: a plural noun."""
    return Sentence("amount-of", "{n} {things}", n=n, things=what)


def with_count(sentence: str, n: int) -> str:
    """Returns a sentence with the number n of its occurrences appended; unchanged for n = 1."""
    return sentence if n == 1 else Sentence("sentence-repeated", "{sentence} ({count} times)", sentence=sentence, count=n)


def first_items(texts: Iterable[object], max_items: int | None = None) -> list[Any]:
    """Returns a list for use as a parameter: at most the first `max_items` items, then an ellipsis."""
    items = list(texts)
    return items if max_items is None or len(items) <= max_items else [*items[:max_items], "..."]


def to_json(value: Any) -> Any:
    """Converts a parameter of a sentence to JSON; a Sentence becomes `{code, params, text}`."""
    if isinstance(value, Sentence):
        return {**value.coded, "text": str.__str__(value)} if value.code else str.__str__(value)
    return [to_json(each) for each in value] if isinstance(value, list) else value


def from_json(value: Any) -> Any:
    """Restores a parameter of a sentence from the JSON of `to_json`. Malformed values are returned unchanged."""
    try:
        return _read(value, 0)
    except (ValueError, KeyError, TypeError, AttributeError):
        return value


def to_text(sentence: str) -> str:
    """Converts a sentence to plain text for storage: to JSON if it has a code, otherwise unchanged."""
    return json.dumps(to_json(sentence), ensure_ascii=False) if isinstance(sentence, Sentence) and sentence.code else sentence


def from_text(text: str) -> str:
    """Restores a sentence from the text of `to_text`; any other text, as stored by older releases, is returned unchanged."""
    if not text.startswith(_BEGINS):
        return text
    try:
        found = from_json(json.loads(text))
    except ValueError:
        return text
    return found if isinstance(found, str) else text


def codes_of(record: Mapping[str, Any]) -> dict[str, Any]:
    """Returns field name -> `{code, params}` for each field of a record that contains a sentence with a code.

    For a field that is a list of texts, the value is a list with `{code, params}` or None for each text.
    """
    found: dict[str, Any] = {}
    for name, value in record.items():
        if _has_code(value):
            found[name] = value.coded
        elif isinstance(value, list) and any(map(_has_code, value)):
            found[name] = [each.coded if _has_code(each) else None for each in value]
    return found


def encoded(record: Mapping[str, Any]) -> dict[str, Any]:
    """Returns a record as JSON, with a field `codes` if it contains sentences with codes; nested records likewise."""
    made = {name: encoded(value) if isinstance(value, dict) else value for name, value in record.items()}
    codes = codes_of(record)
    return {**made, "codes": codes} if codes else made


def decoded(record: Mapping[str, Any], depth: int = 0) -> dict[str, Any]:
    """Restores a record from the JSON of `encoded`. Texts with malformed codes become plain texts.

    depth: nesting level of the record.
    """
    made = {
        name: decoded(value, depth + 1) if isinstance(value, dict) and depth < _DEEPEST else value
        for name, value in record.items()
    }
    codes = made.get("codes")
    if not isinstance(codes, dict):
        return made
    del made["codes"]
    for name, coded in codes.items():
        value = made.get(name)
        if isinstance(value, str):
            made[name] = Sentence.from_coded(value, coded)
        elif isinstance(value, list) and isinstance(coded, list) and len(value) == len(coded):
            made[name] = [
                Sentence.from_coded(text, each) if isinstance(text, str) and each is not None else text
                for text, each in zip(value, coded, strict=True)
            ]
    return made


def _has_code(value: Any) -> bool:
    return isinstance(value, Sentence) and bool(value.code)


def _restored(kind: type[Sentence], text: str, code: str, params: dict[str, Any]) -> Sentence:
    return kind._create(text, code, params)


def _value(value: object) -> Any:
    if isinstance(value, (Sentence, bool, int, float)):
        return value
    if type(value) in (list, tuple):  # a named tuple is a text of its own
        return [_value(each) for each in cast("Iterable[object]", value)]
    if isinstance(value, Integral):  # of numpy
        return int(value)
    text = str(value)  # of an exception, its sentence
    return text if isinstance(text, Sentence) else str.__str__(text)


def _filled(template: str, values: Mapping[str, Any]) -> str:
    def text(match: re.Match[str]) -> str:
        if match[1] not in values:
            return match[0]
        value = values[match[1]]
        if isinstance(value, list):
            return ", ".join(str(each) for each in value)
        following = template[match.end() : match.end() + 1]
        if isinstance(value, Sentence) and following and following in _CLOSING:
            return value.removesuffix(".")
        return str(value)

    return _PLACE.sub(text, template)


def _parsed(coded: Any, depth: int) -> tuple[str, dict[str, Any]]:
    """Returns (code, parameters) of the JSON form `coded` of a sentence. depth: nesting level.

    Raises ValueError, KeyError, TypeError or AttributeError if it is malformed.
    """
    code, params = coded["code"], coded["params"]
    if depth > _DEEPEST or not _CODE.fullmatch(code) or len(code) > 100 or len(params) > _MOST_PARAMS:
        raise ValueError("no code of a sentence")
    return code, {name: _read(value, depth) for name, value in params.items() if str.isidentifier(name)}


def _read(value: Any, depth: int) -> Any:
    if depth > _DEEPEST:
        raise ValueError("sentences are nested too deep")
    if isinstance(value, dict):
        return Sentence._create(_text(value["text"]), *_parsed(value, depth + 1))
    if isinstance(value, list):
        return [_read(each, depth + 1) for each in value[:_MOST_LISTED]]
    if isinstance(value, (bool, int, float)):
        if not abs(value) <= _LARGEST:  # NaN neither
            raise ValueError("no number of a sentence")
        return value
    return _text(value)


def _text(value: str) -> str:
    if not isinstance(value, str) or len(value) > _LONGEST:
        raise ValueError("no text of a sentence")
    return value.replace("\0", "\ufffd")
