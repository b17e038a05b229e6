"""Limits the number of generated triangles: each level of subdivision, one digit in a file, quadruples them."""

from __future__ import annotations

__all__ = ["TriangleBudget"]

_MOST = 4_000_000  # generated triangles per scene
_MOST_OF_ONE = 1_000_000
_DETAILS = ((64, 1), (512, 2))  # (number of shapes, coarseness factor)


class TriangleBudget:
    """Counts the triangles generated for a scene's shapes, and limits those of further shapes."""

    def __init__(self) -> None:
        self._made = self._shapes = 0

    @property
    def triangles_left(self) -> int:
        """Maximum number of triangles that the next shape may generate, within the scene's limit."""
        return min(_MOST_OF_ONE, max(_MOST - self._made, 0))

    def add(self, triangles: int) -> None:
        """Adds generated triangles to the count."""
        self._made += triangles

    def coarser(self) -> int:
        """Counts a quadric, and returns the divisor for its number of segments.

        The divisor is 1 for the first quadrics of a scene, then 2, then 8.
        """
        self._shapes += 1
        return next((by for count, by in _DETAILS if self._shapes <= count), 8)
