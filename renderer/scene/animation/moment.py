"""Moment: the time at which a scene is read, given by a frame number, a frame rate and a clip."""

from __future__ import annotations

from dataclasses import dataclass

from renderer.errors import SettingsError
from renderer.sentences import Sentence

__all__ = ["ALL_CLIPS", "DEFAULT_FPS", "MAX_FRAME", "Moment"]

DEFAULT_FPS = 24.0  # used if neither the request nor the file sets one
LEAST_FPS, MOST_FPS = 1e-3, 1e4
MAX_FRAME = 10_000_000
ALL_CLIPS = "all"  # every clip of a file at once


@dataclass(frozen=True)
class Moment:
    """The time at which a scene is read: frame n, at n / fps seconds. A still is frame 0.

    Frame numbers are multiples of a half, for slow motion. fps: frame rate; None for the file's own, or DEFAULT_FPS if it has
    none. clip: the name or index (from 0) of one of the file's clips, or ALL_CLIPS for all together. Without a clip the first one
    is used, or all in a glTF file if no two of them animate the same object. offset: added to the time, in frames, for moments
    while the shutter is open; it does not change which of several numbered files is read.
    """

    frame: float = 0.0
    fps: float | None = None
    clip: str | None = None
    offset: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.frame <= MAX_FRAME or not float(2 * self.frame).is_integer():
            raise SettingsError(
                Sentence(
                    "frame-number-invalid",
                    "frame is {frame}; it must be from 0 to {max_frame} in steps of a half",
                    frame=f"{self.frame:g}",
                    max_frame=MAX_FRAME,
                )
            )
        if self.fps is not None and not LEAST_FPS <= self.fps <= MOST_FPS:
            raise SettingsError(
                Sentence(
                    "fps-out-of-range",
                    "fps is {fps}; it must be from {least} to {most}",
                    fps=f"{self.fps:g}",
                    least=f"{LEAST_FPS:g}",
                    most=f"{MOST_FPS:g}",
                )
            )

    def seconds(self, own_fps: float = DEFAULT_FPS) -> float:
        """Returns the time of the moment in seconds. own_fps: the file's frame rate, used if the moment specifies no rate."""
        return (self.frame + self.offset) / (own_fps if self.fps is None else self.fps)
