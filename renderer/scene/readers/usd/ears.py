"""Triangulates a concave polygon by ear clipping.

Source: Meisters 1975; only reflex corners can lie in an ear (Eberly, "Triangulation by Ear Clipping").
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["Scissors"]

F64 = npt.NDArray[np.float64]
_MOST_WORK = 100_000  # looks at corners whether they are ears: some seconds
_AT_ONCE = 500  # corners that bend inwards, which a look takes no longer for


class Scissors:
    """Cuts polygons until that has taken long enough; those that come later are fans."""

    def __init__(self) -> None:
        self._left = float(_MOST_WORK)
        self.are_blunt = False

    def cut(self, place: F64) -> npt.NDArray[np.int64]:
        """(n - 2, 3) triangles of one polygon's (n, 3) corners."""
        flat = _flattened(place)
        count = len(flat)
        after, before = np.roll(np.arange(count), -1).tolist(), np.roll(np.arange(count), 1).tolist()
        points = flat.tolist()
        inwards = np.array([_area(points[before[i]], points[i], points[after[i]]) <= 0 for i in range(count)])
        found: list[tuple[int, int, int]] = []
        i = missed = 0
        while count > 3:
            a, c = before[i], after[i]
            bends = np.flatnonzero(inwards)
            self._left -= 1 + len(bends) / _AT_ONCE
            self.are_blunt |= self._left < 0
            if missed > count or self.are_blunt or (not inwards[i] and _is_ear(flat, bends, a, i, c)):
                found.append((a, i, c))
                inwards[i] = False
                after[a], before[c] = c, a
                count -= 1
                missed = 0
                for k in (a, c):
                    if inwards[k]:
                        inwards[k] = _area(points[before[k]], points[k], points[after[k]]) <= 0
            else:
                missed += 1
            i = c
        found.append((before[i], i, after[i]))
        return np.array(found, np.int64)


def _flattened(place: F64) -> F64:
    """(n, 2) the corners in the plane that they lie in most, counter-clockwise."""
    ahead = np.roll(place, -1, axis=0)
    normal = np.cross(place - place[0], ahead - place[0]).sum(axis=0)
    axis = int(np.argmax(np.abs(normal)))
    flat = np.delete(place, axis, axis=1)
    return flat * (-1.0, 1.0) if (normal[axis] < 0) != (axis == 1) else flat  # dropping y turns the plane over


def _is_ear(flat: F64, bends: npt.NDArray[np.int64], i: int, j: int, k: int) -> bool:
    a, b, c = flat[i], flat[j], flat[k]
    others = flat[bends[(bends != i) & (bends != k)]].T
    inside = (_area(a, b, others) >= 0) & (_area(b, c, others) >= 0) & (_area(c, a, others) >= 0)
    return not bool(inside.any())


def _area(a: Any, b: Any, c: Any) -> Any:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
