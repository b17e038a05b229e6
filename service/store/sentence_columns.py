"""Column types that keep sentences with their codes.

A column of texts holds plain text, as older releases wrote it, or the JSON object of a sentence: `{"text", "code", "params"}`.
"""

from __future__ import annotations

from typing import Any

from sqlalchemy import JSON, Dialect, Text
from sqlalchemy.types import TypeDecorator

from renderer.sentences import decoded, encoded, from_json, from_text, to_json, to_text

__all__ = ["SentenceList", "SentenceRecord", "SentenceText"]


class SentenceText(TypeDecorator[str]):
    """A text, which may be a sentence."""

    impl = Text
    cache_ok = True

    def process_bind_param(self, value: str | None, dialect: Dialect) -> str | None:
        """Converts a value to what the column holds."""
        return None if value is None else to_text(value)

    def process_result_value(self, value: str | None, dialect: Dialect) -> str | None:
        """Converts what the column holds to a value."""
        return None if value is None else from_text(value)


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
