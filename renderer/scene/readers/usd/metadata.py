"""Stage metadata, read also if a field is stored with another type than the schema's."""

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
    """Returns the value of a stage field with the type stored in the root layer; None if absent."""
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
    """Returns metres per stage unit."""
    try:
        found = float(UsdGeom.GetStageMetersPerUnit(stage))
    except Tf.ErrorException:
        found = _number(stage, "metersPerUnit", _UNIT, notes)
    if not (math.isfinite(found) and found > 0):
        notes.say(
            Sentence(
                "stage-metersperunit",
                "The stage's metersPerUnit is {found}, which is no length; {unit} is taken.",
                found=found,
                unit=_UNIT,
            )
        )
        return _UNIT
    return found


def is_z_up(stage: Any, notes: Notes) -> bool:
    """Whether the up axis is Z rather than Y."""
    try:
        return bool(UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z)
    except Tf.ErrorException:
        found = stored(stage, "upAxis")
    notes.say(
        Sentence(
            "stage-upaxis-stored",
            "The stage's upAxis is stored as {name} {found}; it is read as that.",
            name=type(found).__name__,
            found=repr(str(found)[:20]),
        )
    )
    return str(found).strip().upper() == "Z"


def rate_of(stage: Any, key: str, notes: Notes) -> float:
    """Returns time codes, or frames, per second."""
    try:
        found = float(stage.GetTimeCodesPerSecond() if key == "timeCodesPerSecond" else stage.GetFramesPerSecond())
    except Tf.ErrorException:
        found = _number(stage, key, _RATE, notes)
    return found if math.isfinite(found) and found > 0 else _RATE


def _number(stage: Any, key: str, default: float, notes: Notes) -> float:
    """Returns the value of a field stored with another type than USD expects, or the default; adds a note."""
    value = stored(stage, key)
    try:
        found = float(value)
    except (TypeError, ValueError):
        notes.say(
            Sentence(
                "stage-stored",
                "The stage's {key} is stored as {name} {value}; {default} is taken.",
                key=key,
                name=type(value).__name__,
                value=repr(str(value)[:20]),
                default=f"{default:g}",
            )
        )
        return default
    notes.say(
        Sentence(
            "stage-not-stored-double",
            "The stage's {key} is not stored as a double; {found} is read.",
            key=key,
            found=f"{found:g}",
        )
    )
    return found
