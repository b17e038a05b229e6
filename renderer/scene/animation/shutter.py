"""The shutter: the part of a frame's time during which it is open, and the number of motion keys in that interval."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from renderer.scene.animation.moment import Moment

__all__ = ["BETWEEN", "SHUTTER", "Shutter"]

SHUTTER = ("shutter", "shutter_at", "shutter_keys")  # the names of the settings of a shutter
BEFORE = {"centred": 0.5, "trailing": 1.0, "leading": 0.0}  # the fraction of the interval before the frame's time


@dataclass(frozen=True)
class Shutter:
    """Duration of the shutter as a fraction of the frame duration, its position relative to the frame, and the number of keys.

    length: 0: no motion blur. at: `centred` on the frame's time, `trailing`: closes at that time, `leading`: opens at that time.
    keys: at equal time steps, the first when it opens and the last when it closes; 0: as many as the motion needs.
    """

    length: float = 0.0
    at: str = "centred"
    keys: int = 0

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Shutter:
        """Returns the shutter described by render settings (name -> value); missing settings have their default values."""
        names = dict(zip(SHUTTER, ("length", "at", "keys"), strict=True))
        return cls(**{names[name]: settings[name] for name in SHUTTER if settings.get(name) is not None})

    def moment(self, moment: Moment, share: float) -> Moment:
        """Returns the moment at a fraction of the shutter interval of the frame `moment`.

        share: 0 when the shutter opens, 1 when it closes.
        """
        return replace(moment, offset=(share - BEFORE[self.at]) * self.length)


BETWEEN = Shutter(2.0, "centred", 3)  # from the previous frame to the next, with one key in between
