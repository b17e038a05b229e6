"""What of a file is not taken over: each thing named once, with the line where it first stands."""

from __future__ import annotations

from typing import NamedTuple

from renderer.errors import SceneError
from renderer.scene.description import SceneDescription

__all__ = ["Notes", "Place"]

_MOST = 200  # kinds of notes; a damaged file may have one for each of its lines


class Place(NamedTuple):
    """Where something stands in a file."""

    file: str
    line: int

    def __str__(self) -> str:
        return f"{self.file}, line {self.line}"

    def wrong(self, sentence: str) -> SceneError:
        """The error that says so."""
        return SceneError(f"{self}: {sentence}")


class Notes:
    """Collects notes, and gives them to a description as warnings."""

    def __init__(self) -> None:
        self._found: dict[str, tuple[Place, int]] = {}
        self._left = 0

    def add(self, place: Place, sentence: str) -> None:
        """Notes something; the same sentence again is counted."""
        first, count = self._found.get(sentence, (place, 0))
        if count or len(self._found) < _MOST:
            self._found[sentence] = (first, count + 1)
        else:
            self._left += 1

    def say(self, description: SceneDescription) -> None:
        """One warning for each."""
        for sentence, (place, count) in self._found.items():
            times = f" ({count} times)" if count > 1 else ""
            description.warnings.append(f"{place}: {sentence}{times}")
        if self._left:
            description.warnings.append(f"{self._left} more things of this file are not taken over")
