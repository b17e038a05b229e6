"""Collects notes about unsupported content of a file, each with the line of its first occurrence."""

from __future__ import annotations

from typing import NamedTuple

from renderer.errors import SceneError
from renderer.scene.description import SceneDescription
from renderer.sentences import Sentence, with_count

__all__ = ["Notes", "Place"]

_MAX_NOTES = 200  # distinct notes; a damaged file may cause one per line


class Place(NamedTuple):
    """A line in a file."""

    file: str
    line: int

    def __str__(self) -> str:
        return f"{self.file}, line {self.line}"

    def with_position(self, fault: str) -> str:
        """Returns a sentence: the file and line, then the fault."""
        return Sentence("fault-in-line", "{file}, line {line}: {fault}", file=self.file, line=self.line, fault=fault)

    def error(self, sentence: str) -> SceneError:
        """Returns a SceneError whose message is the sentence, preceded by the file and line."""
        return SceneError(self.with_position(sentence))


class Notes:
    """Collects notes, and adds them to a description as warnings."""

    def __init__(self) -> None:
        self._found: dict[str, tuple[Place, int]] = {}
        self._left = 0

    def add(self, place: Place, sentence: str) -> None:
        """Adds a note; a repeated note is counted."""
        first, count = self._found.get(sentence, (place, 0))
        if count or len(self._found) < _MAX_NOTES:
            self._found[sentence] = (first, count + 1)
        else:
            self._left += 1

    def add_warnings(self, description: SceneDescription) -> None:
        """Adds one warning per note to the description, with the number of occurrences."""
        for sentence, (place, count) in self._found.items():
            description.warnings.append(place.with_position(with_count(sentence, count)))
        if self._left:
            description.warnings.append(
                Sentence("pbrt-omissions-more", "{count} more features of this file are ignored", count=self._left)
            )
