"""Column types that keep sentences with their codes.

A column of texts holds plain text, as older releases wrote it, or the JSON object of a sentence: `{"text", "code", "params"}`.
"""

from __future__ import annotations

import json
from typing import Any

from sqlalchemy import JSON, Dialect, Text
from sqlalchemy.types import TypeDecorator

from renderer.sentences import Sentence, decoded, encoded, from_json, to_json

__all__ = ["SentenceList", "SentenceRecord", "SentenceText"]

_BEGINS = '{"code": '


class SentenceText(TypeDecorator[str]):
    """A text, which may be a sentence."""

    impl = Text
    cache_ok = True

    def process_bind_param(self, value: str | None, dialect: Dialect) -> str | None:
        """Converts a value to what the column holds."""
        return json.dumps(to_json(value), ensure_ascii=False) if isinstance(value, Sentence) and value.code else value

    def process_result_value(self, value: str | None, dialect: Dialect) -> str | None:
        """Converts what the column holds to a value."""
        if value is None or not value.startswith(_BEGINS):
            return value
        try:
            found = from_json(json.loads(value))
        except ValueError:
            return value
        return found if isinstance(found, str) else value


class SentenceList(TypeDecorator[list[str]]):
    """A JSON list of texts, which may be sentences."""

    impl = JSON
    cache_ok = True

    def process_bind_param(self, value: list[str] | None, dialect: Dialect) -> Any:
        """Converts a value to what the column holds."""
        return None if value is None else [to_json(each) for each in value]

    def process_result_value(self, value: Any, dialect: Dialect) -> list[str] | None:
        """Converts what the column holds to a value."""
        return [from_json(each) for each in value] if isinstance(value, list) else value


class SentenceRecord(TypeDecorator[dict[str, Any]]):
    """A JSON object with texts that may be sentences."""

    impl = JSON
    cache_ok = True

    def process_bind_param(self, value: dict[str, Any] | None, dialect: Dialect) -> Any:
        """Converts a value to what the column holds."""
        return encoded(value) if isinstance(value, dict) else value

    def process_result_value(self, value: Any, dialect: Dialect) -> Any:
        """Converts what the column holds to a value."""
        return decoded(value) if isinstance(value, dict) else value
