"""Limits on generated triangles: one digit in a file adds a level of subdivision, which is four times the triangles."""

from __future__ import annotations

__all__ = ["TriangleBudget"]

_MOST = 4_000_000  # generated triangles per scene
_MOST_OF_ONE = 1_000_000
_DETAILS = ((64, 1), (512, 2))  # (number of shapes, coarseness factor)


class TriangleBudget:
    """Counts the triangles generated for a scene's shapes."""

    def __init__(self) -> None:
        self._made = self._shapes = 0

    @property
    def room(self) -> int:
        """Returns the maximum number of triangles of the next shape."""
        return min(_MOST_OF_ONE, max(_MOST - self._made, 0))

    def add(self, triangles: int) -> None:
        """Counts generated triangles."""
        self._made += triangles

    def coarser(self) -> int:
        """Counts a quadric and returns the factor by which its tessellation is coarser, as there are many: 1, 2 or 8."""
        self._shapes += 1
        return next((by for count, by in _DETAILS if self._shapes <= count), 8)
