"""Reads files of curves: text with a line `x y z radius` for each point, and an empty line between curves.

Source: Mitsuba 3's documentation, plugins "bsplinecurve" and "linearcurve".
"""

from __future__ import annotations

import math
from array import array
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.scene.description import Mesh
from renderer.scene.readers.strands import Strand, line_of, strands_mesh
from renderer.scene.readers.tubes import STEPS
from renderer.sentences import Sentence

__all__ = ["CURVE_BASES", "mesh_of_curves"]

Matrix = npt.NDArray[np.float64]

CURVE_BASES = {"bspline": 4, "bezier": 4, "linear": 2}  # minimum number of points


def mesh_of_curves(basis: str, data: bytes, name: str, world: Matrix, fibres: bool = False, aspect: float = 1.0) -> Mesh:
    """Returns the curves of a file as tubes in world space. basis: of CURVE_BASES; world: (4, 4) transform.

    fibres, aspect: whether their material is hair, and its aspect ratio. As in Mitsuba, points are transformed and radii are not.
    Raises SceneError if the file is malformed.
    """
    strands: list[Strand] = []
    least = CURVE_BASES[basis]
    blocks = _blocks(data.decode("utf-8", "replace"), name)
    for block in blocks:
        if len(block) < least or (basis == "bezier" and len(block) % 3 != 1):
            raise SceneError(
                Sentence(
                    "curve-points-too-few",
                    "{name}: a curve has {found} points; with the basis {basis} it needs {least} or more, and with bezier 3 for "
                    "each further segment",
                    name=name,
                    found=len(block),
                    basis=basis,
                    least=least,
                )
            )
        placed = np.column_stack([block[:, :3] @ world[:3, :3].T + world[:3, 3], np.maximum(block[:, 3], 0)])
        line = placed if basis == "linear" else line_of(placed, basis)
        strands.append(Strand(line[:, :3], line[:, 3], steps=1 if basis == "linear" else STEPS))
    if not strands:
        raise SceneError(Sentence("curves-missing", "{name} has no curves; export it again", name=name))
    return strands_mesh(strands, fibres, aspect)


def _blocks(text: str, name: str) -> list[Matrix]:
    """Returns (N, 4) the points of each curve with their radii."""
    values, ends = array("d"), [0]
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip():
            ends.append(len(values))
            continue
        try:
            row = [float(each) for each in line.replace(",", " ").split()]
        except ValueError:
            row = []
        if len(row) < 4 or not all(map(math.isfinite, row)):
            raise SceneError(
                Sentence(
                    "curve-point-invalid",
                    "{name}, line {line}: a point of a curve needs four numbers, x, y, z and a radius, with spaces between",
                    name=name,
                    line=number,
                )
            )
        values.extend(row[:4])
    ends.append(len(values))
    rows = np.array(values).reshape(-1, 4)
    return [rows[begin // 4 : end // 4] for begin, end in pairwise(ends) if begin < end]
