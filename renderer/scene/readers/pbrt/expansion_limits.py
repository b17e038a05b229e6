"""How much a few words may expand to: a level of subdivision is one digit in a file, and four times the triangles."""

from __future__ import annotations

__all__ = ["Growth"]

_MOST = 4_000_000  # triangles that are made by formula, of a scene
_MOST_OF_ONE = 1_000_000
_DETAILS = ((64, 1), (512, 2))  # up to how many shapes, and by how much the next ones are drawn coarser


class Growth:
    """Counts what was made of a scene's shapes by formula."""

    def __init__(self) -> None:
        self._made = self._shapes = 0

    @property
    def room(self) -> int:
        """How many triangles the next shape may be refined to."""
        return min(_MOST_OF_ONE, max(_MOST - self._made, 0))

    def add(self, triangles: int) -> None:
        """So many were made."""
        self._made += triangles

    def coarser(self) -> int:
        """By how much the next round shape is drawn coarser, as there are many: 1, 2 or 8."""
        self._shapes += 1
        return next((by for count, by in _DETAILS if self._shapes <= count), 8)
