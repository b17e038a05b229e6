"""Column types for sentences with codes.

A text column contains plain text, as written by older releases, or a sentence as JSON: `{"text", "code", "params"}`.
"""

from __future__ import annotations

from typing import Any

from sqlalchemy import JSON, Dialect, Text
from sqlalchemy.types import TypeDecorator

from renderer.sentences import decoded, encoded, from_json, from_text, to_json, to_text

__all__ = ["SentenceList", "SentenceRecord", "SentenceText"]


class SentenceText(TypeDecorator[str]):
    """Column type: a text, which may be a sentence with a code."""

    impl = Text
    cache_ok = True

    def process_bind_param(self, value: str | None, dialect: Dialect) -> str | None:
        """Encodes a sentence for the database."""
        return None if value is None else to_text(value)

    def process_result_value(self, value: str | None, dialect: Dialect) -> str | None:
        """Decodes a sentence from the database."""
        return None if value is None else from_text(value)


class SentenceList(TypeDecorator[list[str]]):
    """Column type: a JSON list of texts, which may be sentences with codes."""

    impl = JSON
    cache_ok = True

    def process_bind_param(self, value: list[str] | None, dialect: Dialect) -> Any:
        """Encodes a list of sentences for the database."""
        return None if value is None else [to_json(each) for each in value]

    def process_result_value(self, value: Any, dialect: Dialect) -> list[str] | None:
        """Decodes a list of sentences from the database."""
        return [from_json(each) for each in value] if isinstance(value, list) else value


class SentenceRecord(TypeDecorator[dict[str, Any]]):
    """Column type: a JSON object with texts that may be sentences with codes."""

    impl = JSON
    cache_ok = True

    def process_bind_param(self, value: dict[str, Any] | None, dialect: Dialect) -> Any:
        """Encodes an object with sentences for the database."""
        return encoded(value) if isinstance(value, dict) else value

    def process_result_value(self, value: Any, dialect: Dialect) -> Any:
        """Decodes an object with sentences from the database."""
        return decoded(value) if isinstance(value, dict) else value
