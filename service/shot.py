"""The part of a request for several frames that is not in the settings, as stored in the job's row."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any, Self

from renderer.frames import frame_key, frame_number, frames_text, parse_frames

__all__ = ["IN_TURN", "Shot"]

IN_TURN = "in-turn"


@dataclass(frozen=True)
class Shot:
    """The parameters of a shot.

    fps, clip: as in renderer.scene.animation.Moment. turntable: seconds per revolution of the camera. order: one of
    renderer.work.ORDERS; every: its n. first: the frame that is rendered before all others (frame_key). revision: increases with
    each change after which the engine must check the frames. anew: frames whose samples must be discarded first, cleared when
    that is done, as renderer.frames.frames_text writes them. frames: all frames, in the same notation; None if an earlier release
    wrote the row.
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
        """Reads a shot from a job's row; None for a still. Unknown fields, from other releases, are ignored."""
        if not data:
            return None
        known = {name: data[name] for name in cls.__dataclass_fields__ if name in data}
        if isinstance(known.get("anew"), list):  # a list of keys, as earlier releases wrote it
            known["anew"] = frames_text([frame_number(key) for key in known["anew"]])
        return cls(**known)

    @property
    def anew_keys(self) -> list[int]:
        """The keys of the frames whose samples must be discarded."""
        return [frame_key(number) for number in parse_frames(self.anew)] if self.anew else []

    def to_json(self) -> dict[str, Any]:
        """Returns the shot as stored in the job's row."""
        return asdict(self)

    def changed(self, **what: Any) -> Self:
        """Returns a copy with changed fields and the next revision."""
        return replace(self, **what, revision=self.revision + 1)
