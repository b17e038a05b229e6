"""Reads stage metadata, including fields whose stored type differs from the schema's."""

from __future__ import annotations

import math
from typing import Any

from pxr import Tf, UsdGeom

from renderer.scene.readers.usd.notes import Notes
from renderer.sentences import Sentence

__all__ = ["is_z_up", "rate_of", "stored", "unit_of"]

_UNIT = 0.01  # default, in metres
_RATE = 24.0


def stored(stage: Any, key: str) -> Any:
    """Returns the value of a stage metadata field, of whatever type the root layer stores; None if absent."""
    try:
        return stage.GetMetadata(key)
    except Tf.ErrorException:
        pass
    try:
        root = stage.GetRootLayer().pseudoRoot
        return root.GetInfo(key) if root.HasInfo(key) else None
    except Tf.ErrorException:
        return None


def unit_of(stage: Any, notes: Notes) -> float:
    """Returns the stage's metres per unit; 0.01, with a note, if the stored value is invalid."""
    try:
        found = float(UsdGeom.GetStageMetersPerUnit(stage))
    except Tf.ErrorException:
        found = _number(stage, "metersPerUnit", _UNIT, notes)
    if not (math.isfinite(found) and found > 0):
        notes.add_sentence(
            Sentence(
                "usd-meters-per-unit-invalid",
                "The stage's metersPerUnit is {value}, which is not a length; {unit} is used.",
                value=found,
                unit=_UNIT,
            )
        )
        return _UNIT
    return found


def is_z_up(stage: Any, notes: Notes) -> bool:
    """Returns True if the stage's up axis is Z rather than Y."""
    try:
        return bool(UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z)
    except Tf.ErrorException:
        found = stored(stage, "upAxis")
    notes.add_sentence(
        Sentence(
            "usd-up-axis-type-wrong",
            "The stage's upAxis is stored as {type} {value}; it is used nevertheless.",
            type=type(found).__name__,
            value=repr(str(found)[:20]),
        )
    )
    return str(found).strip().upper() == "Z"


def rate_of(stage: Any, key: str, notes: Notes) -> float:
    """Returns a rate of the stage, in time codes or frames per second; 24 if the stored value is invalid.

    key: name of the metadata field.
    """
    try:
        found = float(stage.GetTimeCodesPerSecond() if key == "timeCodesPerSecond" else stage.GetFramesPerSecond())
    except Tf.ErrorException:
        found = _number(stage, key, _RATE, notes)
    return found if math.isfinite(found) and found > 0 else _RATE


def _number(stage: Any, key: str, default: float, notes: Notes) -> float:
    """Returns a numeric metadata field that is stored with another type than USD expects, or the default; adds a note."""
    value = stored(stage, key)
    try:
        found = float(value)
    except (TypeError, ValueError):
        notes.add_sentence(
            Sentence(
                "usd-metadata-type-wrong",
                "The stage's {key} is stored as {type} {value}; {default} is used.",
                key=key,
                type=type(value).__name__,
                value=repr(str(value)[:20]),
                default=f"{default:g}",
            )
        )
        return default
    notes.add_sentence(
        Sentence(
            "usd-metadata-not-double",
            "The stage's {key} is not stored as a double; {value} is used.",
            key=key,
            value=f"{found:g}",
        )
    )
    return found
