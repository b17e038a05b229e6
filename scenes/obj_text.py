"""Writer for OBJ files with polygons by material, boxes and surfaces of revolution."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product

__all__ = ["Obj", "number"]

Point = Sequence[float]


def number(value: float, digits: int = 3) -> str:
    """Returns a number as text, rounded to `digits` without trailing zeros."""
    text = f"{value:.{digits}f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text.replace("0.", ".", 1) if abs(value) < 1 else text


class Obj:
    """Text of an OBJ file.

    Face corners use negative indices, relative to the latest point, so parts are independent of each other.
    """

    def __init__(self, library: str, digits: int = 3) -> None:
        self._lines = [f"mtllib {library}"]
        self._material = ""
        self._digits = digits

    def use(self, material: str) -> None:
        """Sets the material of the polygons that follow."""
        if material != self._material:
            self._lines.append(f"usemtl {material}")
            self._material = material

    def add(self, points: Sequence[Point], faces: Sequence[Sequence[int]], uvs: Sequence[Point] | None = None) -> None:
        """Adds polygons over points numbered from 0, counter-clockwise as seen from outside, with a UV per point."""
        self._points(points, uvs)
        for face in faces:
            self._face([i - len(points) for i in face], uvs is not None)

    def _points(self, points: Sequence[Point], uvs: Sequence[Point] | None) -> None:
        self._lines += ["v " + " ".join(number(c, self._digits) for c in p) for p in points]
        if uvs is not None:
            self._lines += ["vt " + " ".join(number(c) for c in uv) for uv in uvs]

    def _face(self, corners: Sequence[int], mapped: bool) -> None:
        self._lines.append("f " + " ".join(f"{i}/{i}" if mapped else f"{i}" for i in corners))

    def grid(self, rows: Sequence[Sequence[Point]], uvs: Sequence[Sequence[Point]] | None = None) -> None:
        """Adds a sheet of quads, seen from the front with rows going down and columns to the right."""
        width = len(rows[0])
        for j, row in enumerate(rows):
            self._points(row, None if uvs is None else uvs[j])
            for i in range(-width, -1) if j else ():
                self._face([i - width, i, i + 1, i + 1 - width], uvs is not None)

    def box(self, center: Point, half: Point) -> None:
        """Adds a box."""
        corners = [[c + s * h for c, s, h in zip(center, signs, half, strict=True)] for signs in product((-1, 1), repeat=3)]
        self.add(corners, [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])

    def lathe(self, profile: Sequence[tuple[float, float]], segments: int, at: Point = (0, 0, 0), mapped: bool = False) -> None:
        """Adds a surface of revolution of (radius, y) points about Y, from the bottom up.

        mapped: whether to add UVs in 0..1, around and along the profile.
        """
        rows, uvs = [], []
        for j, (radius, y) in reversed(list(enumerate(profile))):
            turns = [2 * math.pi * i / segments for i in range(segments + 1)]
            rows.append([(at[0] + radius * math.sin(t), at[1] + y, at[2] + radius * math.cos(t)) for t in turns])
            uvs.append([(i / segments, j / (len(profile) - 1)) for i in range(segments + 1)])
        self.grid(rows, uvs if mapped else None)

    def text(self) -> str:
        """Returns the file's text."""
        return "\n".join(self._lines) + "\n"
