"""The middle of each pixel's exposure with a rolling shutter, as a time of a compiled scene's keys."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.kernel.camera import readout_of
from renderer.scene.animation import BETWEEN, Shutter
from renderer.scene.animation.shutter import BEFORE
from renderer.settings import MOST_KEYS, RenderSettings

__all__ = ["PixelTimes", "pixel_times", "window_between"]

F64 = npt.NDArray[np.float64]

_STEPS = 4  # of motion in the time of a shutter, as least often for a picture (renderer/scene/shutter_merge.py)


class PixelTimes(NamedTuple):
    """Times as linear functions of the position in the picture, in pixels from the upper left corner; 0 ... 1 over the keys."""

    first: float
    across: float
    down: float
    frame: float  # duration of a frame

    def at(self, x: F64, y: F64) -> F64:
        """Returns the middles of the exposures of positions (x, y)."""
        return self.first + self.across * x + self.down * y

    @property
    def is_rolling(self) -> bool:
        """Returns True if pixels are exposed at different times."""
        return self.across != 0.0 or self.down != 0.0


def window_between(settings: RenderSettings) -> Shutter:
    """Returns the time over which a scene is compiled for flow: from the previous frame's exposure to the next one's.

    Without a rolling shutter, from the previous to the next frame.
    """
    if not settings.rolling_shutter:
        return BETWEEN
    before = BEFORE[settings.shutter_at]
    length = 2.0 + 2.0 * max(before, 1.0 - before) * settings.shutter
    steps = (settings.shutter_keys - 1) if settings.shutter_keys else _STEPS
    half = min(int(np.ceil(steps * length / settings.shutter / 2.0)), MOST_KEYS // 2)
    return Shutter(length, "centred", 2 * half + 1)


def pixel_times(settings: RenderSettings, window: Shutter | None = None) -> PixelTimes:
    """Returns the times of a picture's pixels. window: over which the scene is compiled; None: over the settings' own shutter.

    Without a rolling shutter, all times are the middle of the window, as for a picture at one moment.
    """
    frame = 0.0 if window is None else 1.0 / window.length
    if not settings.rolling_shutter:
        return PixelTimes(0.5, 0.0, 0.0, frame)
    exposure, first, across, down = readout_of(settings)
    middle = first + exposure / 2.0
    if window is None:
        return PixelTimes(middle, across, down, frame)
    scale = settings.shutter / window.length
    return PixelTimes(0.5 + (middle - BEFORE[settings.shutter_at]) * scale, across * scale, down * scale, frame)
