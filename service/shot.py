"""Parameters of a shot (a job that renders several frames) that are stored in the job's row and are not render settings."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Self

from renderer.frames import frame_key, frame_number, frames_text, parse_frames

__all__ = ["IN_TURN_ORDER", "Shot", "variation_of"]

IN_TURN_ORDER = "in-turn"


@dataclass(frozen=True)
class Shot:
    """The parameters of a shot, a job that renders several frames.

    fps, clip: as in renderer.scene.animation.Moment. turntable: seconds per revolution of the camera; None: no revolution.
    order: order of the frames, one of renderer.work.ORDERS. every: for orders that first render every n-th frame, this n.
    first: key of the frame to render before all others (frame_key). revision: increases with each change after which the engine
    must check the frames. anew: frames whose samples must be discarded first, in the notation of renderer.frames.frames_text;
    cleared when done. frames: all frames in that notation; None if an earlier release wrote the row. vary: the scene file's
    variation, which applies unless the request has its own.
    """

    fps: float | None = None
    clip: str | None = None
    turntable: float | None = None
    order: str = IN_TURN_ORDER
    every: int = 8
    first: int | None = None
    revision: int = 0
    anew: str = ""
    frames: str | None = None
    vary: dict[str, Any] | None = None

    @classmethod
    def parse(cls, data: Mapping[str, Any] | None) -> Self | None:
        """Returns the shot stored in a job's row; None for a still image.

        Ignores unknown fields, which other releases may write.
        """
        if not data:
            return None
        known = {name: data[name] for name in (each.name for each in fields(cls)) if name in data}
        if isinstance(known.get("anew"), list):  # a list of keys, as earlier releases wrote it
            known["anew"] = frames_text([frame_number(key) for key in known["anew"]])
        return cls(**known)

    @property
    def anew_keys(self) -> list[int]:
        """Returns the keys of the frames whose samples must be discarded."""
        return [frame_key(number) for number in parse_frames(self.anew)] if self.anew else []

    def to_json(self) -> dict[str, Any]:
        """Returns the shot in the form stored in a job's row. Omits `vary` if it is None, as earlier releases do."""
        return {name: value for name, value in asdict(self).items() if value is not None or name != "vary"}

    def with_changes(self, **what: Any) -> Self:
        """Returns a copy in which the given fields are changed and `revision` is increased by one."""
        return replace(self, **what, revision=self.revision + 1)


def variation_of(request: Mapping[str, Any], shot: Shot | None) -> dict[str, Any] | None:
    """Returns how a job's scene varies: as its request says, else as its scene file does; None if it does not vary."""
    given = request.get("vary")
    if given is None:
        return None if shot is None else shot.vary
    return given or None
