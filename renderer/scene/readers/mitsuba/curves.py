"""Reads Mitsuba's curves: a text file of `x y z radius` lines, with an empty line between curves.

Source: Mitsuba 3's documentation, plugin "bsplinecurve".
"""

from __future__ import annotations

import numpy as np

from renderer.errors import SceneError
from renderer.scene.description import Mesh
from renderer.scene.readers.mitsuba.values import Matrix, numbers
from renderer.scene.readers.strands import Strand, line_of, strands_mesh
from renderer.sentences import Sentence

__all__ = ["CURVES", "mesh_of_curves"]

CURVES = {"bsplinecurve": 4, "linearcurve": 2}  # minimum number of points by type


def mesh_of_curves(kind: str, data: bytes, name: str, world: Matrix) -> Mesh:
    """Returns the curves of a file as tubes in world space. kind: bsplinecurve or linearcurve; world: (4, 4) transform.

    As in Mitsuba, points are transformed and radii are not. Raises SceneError if the file is malformed.
    """
    strands: list[Strand] = []
    for block in _blocks(data.decode("utf-8", "replace"), name):
        if len(block) < CURVES[kind]:
            raise SceneError(
                Sentence(
                    "mitsuba-curve-points-too-few",
                    "{name}: a curve has {found} points; a {kind} needs {least} or more",
                    name=name,
                    found=len(block),
                    kind=kind,
                    least=CURVES[kind],
                )
            )
        placed = np.column_stack([block[:, :3] @ world[:3, :3].T + world[:3, 3], np.maximum(block[:, 3], 0)])
        line = line_of(placed, "bspline") if kind == "bsplinecurve" else placed
        strands.append((line[:, :3], line[:, 3]))
    if not strands:
        raise SceneError(Sentence("mitsuba-curves-missing", "{name}: has no curves; export it again", name=name))
    return strands_mesh(strands)


def _blocks(text: str, name: str) -> list[Matrix]:
    blocks: list[list[Matrix]] = [[]]
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip():
            blocks.append([])
            continue
        try:
            row = numbers(line)
        except ValueError as error:
            raise SceneError(
                Sentence("fault-in-line", "{file}, line {line}: {fault}", file=name, line=number, fault=error)
            ) from None
        if len(row) < 4:
            raise SceneError(
                Sentence(
                    "mitsuba-curve-number-count-wrong",
                    "{name}, line {line}: has {found} numbers; a point of a curve has x, y, z and a radius",
                    name=name,
                    line=number,
                    found=len(row),
                )
            )
        blocks[-1].append(row[:4])
    return [np.array(block) for block in blocks if block]
