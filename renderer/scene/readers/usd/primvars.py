"""Reads primvars as numpy arrays, optionally per corner of a mesh."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from pxr import UsdGeom

from renderer.scene.description import F32
from renderer.scene.readers.usd.notes import Notes
from renderer.scene.subdivision.polygons import AtCorners, Faces
from renderer.sentences import Sentence

__all__ = ["array", "at_corners", "constant", "constant_value", "find_primvar", "integers", "varies"]


def array(value: Any, width: int) -> F32:
    """Returns (N, width) float32 from a USD array or single value; empty if it is absent, not numeric or of another width."""
    if value is None:
        return np.zeros((0, width), np.float32)
    values = np.asarray(value)
    if values.dtype.kind not in "fiu" or values.size % width:
        return np.zeros((0, width), np.float32)
    return np.ascontiguousarray(values.reshape(-1, width), np.float32)


def integers(value: Any) -> npt.NDArray[np.int64]:
    """Returns (N,) integers from a USD array; empty if it is absent or not of an integer type, as in damaged layers."""
    values = np.asarray(() if value is None else value)
    return np.asarray(values if values.dtype.kind in "iu" else (), np.int64).reshape(-1)


def find_primvar(prim: Any, name: str) -> Any:
    """Returns a prim's own or inherited primvar; None if it has no value."""
    primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
    return primvar if primvar and primvar.HasValue() else None


def varies(primvar: Any) -> bool:
    """Returns True if the value of a primvar changes over time."""
    return bool(primvar.ValueMightBeTimeVarying())


def constant(prim: Any, name: str, width: int, time: Any) -> npt.NDArray[np.float32] | None:
    """Returns the (width,) value of a constant primvar; None if it varies over the surface, is absent or not finite."""
    primvar = find_primvar(prim, name)
    if primvar is None:
        return None
    values = array(primvar.ComputeFlattened(time), width)
    is_constant = len(values) == 1 or (len(values) > 0 and primvar.GetInterpolation() == "constant")
    return values[0] if is_constant and np.isfinite(values[0]).all() else None


def constant_value(prim: Any, name: str, time: Any) -> float | tuple[float, ...] | None:
    """Returns the value of a constant primvar as number or tuple; None if it varies over the surface or is not numeric."""
    primvar = find_primvar(prim, name)
    if primvar is None or primvar.GetInterpolation() != "constant":
        return None
    values = np.asarray(primvar.ComputeFlattened(time))
    if values.dtype.kind not in "fiu" or values.size == 0 or not np.isfinite(values).all():
        return None
    first = values if primvar.GetTypeName().scalarType == primvar.GetTypeName() else values[0]
    return float(first) if np.ndim(first) == 0 else tuple(float(v) for v in first)


def at_corners(primvar: Any, width: int | None, faces: Faces, points: int, time: Any, notes: Notes) -> AtCorners | None:
    """Returns the values of a primvar at a mesh's corners; None, with a note, if their number does not fit the mesh.

    width: components per value; None for those that the primvar has. points: the mesh's point count.
    """
    given = primvar.Get(time)
    shape = np.shape(given)
    values = array(given, (shape[1] if len(shape) == 2 else 1) if width is None else width)
    indices = np.asarray(primvar.GetIndices(time) or (), np.int64) if primvar.IsIndexed() else None
    return values_at_corners(values, indices, primvar.GetInterpolation(), faces, points, primvar.GetAttr().GetPath(), notes)


def values_at_corners(
    values: F32,
    indices: npt.NDArray[np.int64] | None,
    interpolation: str,
    faces: Faces,
    points: int,
    path: Any,
    notes: Notes,
) -> AtCorners | None:
    """Returns values as the values at a mesh's corners; None, with a note, if their number does not fit the mesh.

    indices: of an indexed primvar, or None. interpolation: USD's, such as `vertex`. points: the mesh's point count. path: the
    primvar's path, for the note.
    """
    code = {
        "constant": lambda: np.zeros(len(faces.corners), np.int64),
        "uniform": lambda: faces.face,
        "vertex": lambda: faces.corners,
        "varying": lambda: faces.corners,
        "faceVarying": lambda: np.arange(len(faces.corners)),
    }[interpolation]()
    wanted = {"constant": 1, "uniform": len(faces.counts), "faceVarying": len(faces.corners)}.get(interpolation, points)
    given = len(values) if indices is None else len(indices)
    fits = given >= wanted and bool(np.isfinite(values).all())
    if fits and indices is not None:
        fits = bool(indices.min(initial=0) >= 0 and indices.max(initial=-1) < len(values))
        code = indices[code] if fits else code
    if not fits:
        notes.add(Sentence("usd-primvars-mismatched", "Primvars that do not fit their meshes are left out"), str(path))
        return None
    is_indexed = indices is not None and interpolation == "faceVarying"
    return AtCorners(values, code, interpolation in ("constant", "vertex", "varying"), is_indexed=is_indexed)
