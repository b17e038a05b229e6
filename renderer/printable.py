"""Escapes control characters in names and messages from files, users and other machines before they reach a terminal."""

from __future__ import annotations

import logging
import re

__all__ = ["LogRecord", "one_line", "printable"]

# C0 and C1 controls but tab and line feed, line and paragraph separators, embeddings, overrides and isolates of the bidirectional
# algorithm (which show one text as another), and surrogates, which no stream encodes.
UNSAFE = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


def printable(text: str) -> str:
    r"""Returns the text with unsafe characters as escapes such as \u001b. Tabs and line feeds stay; JSON remains equivalent."""
    return UNSAFE.sub(lambda found: f"\\u{ord(found[0]):04x}", text)


def one_line(text: str) -> str:
    """Returns the `printable` text with tabs and line feeds replaced by spaces."""
    return printable(text).replace("\n", " ").replace("\t", " ")


class LogRecord(logging.LogRecord):
    """A log record with `printable` message and traceback, for `logging.setLogRecordFactory`: safe with every handler."""

    def getMessage(self) -> str:  # noqa: N802 - of the base class
        """Returns the message with its arguments."""
        return printable(super().getMessage())

    @property
    def exc_text(self) -> str | None:
        """The text of a traceback, printable, which formatters of `logging` cache here."""
        return self._exc_text

    @exc_text.setter
    def exc_text(self, text: str | None) -> None:
        self._exc_text = text if text is None else printable(text)
