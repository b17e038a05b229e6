"""The shutter: the interval during which it is open, relative to a frame, and the keys of moving objects in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from renderer.scene.animation.moment import Moment

__all__ = ["BETWEEN", "SHUTTER", "Shutter"]

SHUTTER = ("shutter", "shutter_at", "shutter_keys")  # the names of the settings of a shutter
BEFORE = {"centred": 0.5, "trailing": 1.0, "leading": 0.0}  # the fraction of it before the frame's time


@dataclass(frozen=True)
class Shutter:
    """Shutter duration as a fraction of a frame's, its position relative to the frame, and the number of keys.

    length: 0: no motion blur. at: `centred` about the frame's time, `trailing`: it closes there, or `leading`: it opens there.
    keys: at equal steps, the first as it opens and the last as it closes; 0: as many as the motion needs.
    """

    length: float = 0.0
    at: str = "centred"
    keys: int = 0

    @classmethod
    def of(cls, settings: Mapping[str, Any]) -> Shutter:
        """Returns the shutter of settings by their names, with defaults for missing ones."""
        names = dict(zip(SHUTTER, ("length", "at", "keys"), strict=True))
        return cls(**{names[name]: settings[name] for name in SHUTTER if settings.get(name) is not None})

    def moment(self, moment: Moment, share: float) -> Moment:
        """Returns the moment of a frame at a fraction of the interval from opening, 0, to closing, 1."""
        return replace(moment, offset=(share - BEFORE[self.at]) * self.length)


BETWEEN = Shutter(2.0, "centred", 3)  # from the previous frame to the next, with one key in between
