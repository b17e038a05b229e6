"""A description's warnings, each of them once."""

from __future__ import annotations

__all__ = ["MOST_WARNINGS", "Warned"]

MOST_WARNINGS = 1000  # nobody reads more, and a file may have a hundred thousand materials without their textures


class Warned:
    """Adds to a list of warnings, which may also grow by itself."""

    def __init__(self, warnings: list[str]) -> None:
        self._warnings = warnings
        self._known: set[str] = set()
        self._seen = 0

    def add(self, sentence: str) -> None:
        """Adds a sentence that is not there; past MOST_WARNINGS, only that there are more."""
        self._known.update(self._warnings[self._seen :])
        if sentence not in self._known and len(self._warnings) <= MOST_WARNINGS:
            more = f"There are more warnings: these are the first {MOST_WARNINGS}."
            self._warnings.append(sentence if len(self._warnings) < MOST_WARNINGS else more)
        self._seen = len(self._warnings)
