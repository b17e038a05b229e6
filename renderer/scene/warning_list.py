"""Adds warnings to a description, each once."""

from __future__ import annotations

__all__ = ["MOST_WARNINGS", "WarningList"]

MOST_WARNINGS = 1000  # more are not useful, and a file may have a hundred thousand materials without their textures


class WarningList:
    """Adds warnings to a list, each once. Other code may append to the list directly."""

    def __init__(self, warnings: list[str]) -> None:
        self._warnings = warnings
        self._known: set[str] = set()
        self._seen = 0

    def add(self, sentence: str) -> None:
        """Adds a warning unless it is present. Beyond MOST_WARNINGS, adds only a note that there are more."""
        self._known.update(self._warnings[self._seen :])
        if sentence not in self._known and len(self._warnings) <= MOST_WARNINGS:
            more = f"There are more warnings: these are the first {MOST_WARNINGS}."
            self._warnings.append(sentence if len(self._warnings) < MOST_WARNINGS else more)
        self._seen = len(self._warnings)
