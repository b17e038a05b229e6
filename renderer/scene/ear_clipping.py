"""Triangulates a polygon by ear clipping.

Source: Meisters 1975. Only reflex corners can be inside an ear (Eberly, "Triangulation by Ear Clipping"). Polygons that touch
themselves, such as those with a bridge to a hole, pass through a point more than once: a corner at the same point as a corner
of the ear does not block the ear.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

__all__ = ["EarClipper"]

F64 = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
_MOST_WORK = 100_000  # examined corners: some seconds
_AT_ONCE = 500  # reflex corners whose test takes as long as the call itself
_NOISE = 1e-13  # relative to the square of the polygon's size: smaller areas are taken as 0
_CLEAN, _TOUCHING, _ANY = range(3)  # how strictly an ear is tested


class EarClipper:
    """Triangulates polygons by ear clipping, up to a limit on the total work.

    Once the limit is reached, `are_blunt` is True, and the caller should triangulate further polygons as fans.
    """

    def __init__(self) -> None:
        self._left = float(_MOST_WORK)
        self.are_blunt = False

    def triangulate(self, place: F64) -> npt.NDArray[np.int64]:
        """Returns the (n - 2, 3) triangles of one polygon. place: (n, 3) corners."""
        flat = flattened(place)
        count = len(flat)
        noise = _NOISE * float(np.ptp(flat, axis=0).max(initial=0.0)) ** 2
        after, before = np.roll(np.arange(count), -1).tolist(), np.roll(np.arange(count), 1).tolist()
        points = flat.tolist()

        def signed_area(k: int) -> float:
            area: float = _area(points[before[k]], points[k], points[after[k]])
            return 0.0 if abs(area) <= noise else area

        turns = [signed_area(k) for k in range(count)]
        reflex = np.array([t <= 0 for t in turns])
        found: list[tuple[int, int, int]] = []
        i = missed = 0
        strictness = _CLEAN
        while count > 3:
            a, c = before[i], after[i]
            bends = np.flatnonzero(reflex)
            self._left -= 1 + len(bends) / _AT_ONCE
            self.are_blunt |= self._left < 0
            if self.are_blunt or _is_ear(flat, bends, (a, i, c), turns[i], strictness):
                found.append((a, i, c))
                reflex[i] = False
                after[a], before[c] = c, a
                count -= 1
                missed, strictness = 0, _CLEAN
                for k in (a, c):
                    turns[k] = signed_area(k)
                    reflex[k] = turns[k] <= 0
            else:
                missed += 1
                if missed >= count:  # no ear of this strictness is left
                    missed, strictness = 0, strictness + 1
            i = c
        found.append((before[i], i, after[i]))
        return np.array(found, np.int64)


def flattened(place: F64) -> F64:
    """Returns the polygon's corners projected to 2D, (n, 2), in counter-clockwise order.

    The projection is along the coordinate axis closest to the polygon's normal.
    """
    ahead = np.roll(place, -1, axis=0)
    normal = np.cross(place - place[0], ahead - place[0]).sum(axis=0)
    axis = int(np.argmax(np.abs(normal)))
    flat = np.delete(place, axis, axis=1)
    flat = flat - flat[0]
    return flat * (-1.0, 1.0) if (normal[axis] < 0) != (axis == 1) else flat  # dropping y reverses the orientation


def _is_ear(flat: F64, bends: npt.NDArray[np.int64], corners: tuple[int, int, int], signed_area: float, strictness: int) -> bool:
    """Returns True if a corner may be clipped as an ear.

    strictness: by default no other corner may be inside the ear or on its edges; `_TOUCHING` allows corners on edges and ears
    without area; `_ANY` allows every corner.
    """
    if strictness == _ANY:
        return True
    if signed_area <= 0:
        return strictness == _TOUCHING and signed_area == 0
    i, j, k = corners
    a, b, c = flat[i], flat[j], flat[k]
    others = flat[bends[(bends != i) & (bends != j) & (bends != k)]]
    same = (others == a).all(axis=1) | (others == b).all(axis=1) | (others == c).all(axis=1)
    areas = np.stack([_area(p, q, others[~same].T) for p, q in ((a, b), (b, c), (c, a))])
    inside = areas > 0 if strictness == _TOUCHING else areas >= 0
    return not bool(inside.all(axis=0).any())


def _area(a: Any, b: Any, c: Any) -> Any:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
