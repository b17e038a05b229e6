"""What a request for a job of several frames says besides its settings, as its row stores it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Self

from renderer.frames import frame_key, frame_number, frames_text, parse_frames

__all__ = ["IN_TURN", "Shot"]

IN_TURN = "in-turn"


@dataclass(frozen=True)
class Shot:
    """fps, clip: as renderer.scene.animation.Moment has them. turntable: seconds in which the camera goes around once.

    order: one of renderer.work.ORDERS, every: its n. first: the frame that goes before all others (frame_key).
    revision: grows with every change that the engine must look at its frames for. anew: those whose samples are to be forgotten
    first, until that is done, as renderer.frames.frames_text writes them. frames: all of them, likewise; None where an earlier
    release wrote the row.
    """

    fps: float | None = None
    clip: str | None = None
    turntable: float | None = None
    order: str = IN_TURN
    every: int = 8
    first: int | None = None
    revision: int = 0
    anew: str = ""
    frames: str | None = None

    @classmethod
    def of(cls, data: Mapping[str, Any] | None) -> Self | None:
        """From a job's row; None where it is a still. What another release says besides is left out."""
        if not data:
            return None
        known = {name: data[name] for name in cls.__dataclass_fields__ if name in data}
        if isinstance(known.get("anew"), list):  # by their keys, as earlier releases wrote it
            known["anew"] = frames_text([frame_number(key) for key in known["anew"]])
        return cls(**known)

    @property
    def anew_keys(self) -> list[int]:
        """Of the frames whose samples are to be forgotten."""
        return [frame_key(number) for number in parse_frames(self.anew)] if self.anew else []

    def to_json(self) -> dict[str, Any]:
        """For the job's row."""
        return asdict(self)

    def changed(self, **what: Any) -> Self:
        """With other frames, or other things asked of them."""
        return replace(self, **what, revision=self.revision + 1)
