"""What a request for a job of several frames says besides its settings, as its row stores it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Self

__all__ = ["IN_TURN", "Shot"]

IN_TURN = "in-turn"


@dataclass(frozen=True)
class Shot:
    """fps, clip: as renderer.scene.animation.Moment has them. turntable: seconds in which the camera goes around once.

    order: one of renderer.work.ORDERS, every: its n. first: the frame that goes before all others (frame_key).
    revision: grows with every change that the engine must look at its frames for. anew: those whose samples are to be forgotten
    first, until that is done.
    """

    fps: float | None = None
    clip: str | None = None
    turntable: float | None = None
    order: str = IN_TURN
    every: int = 8
    first: int | None = None
    revision: int = 0
    anew: list[int] = field(default_factory=list)

    @classmethod
    def of(cls, data: Mapping[str, Any] | None) -> Self | None:
        """From a job's row; None where it is a still. What another release says besides is left out."""
        if not data:
            return None
        return cls(**{name: data[name] for name in cls.__dataclass_fields__ if name in data})

    def to_json(self) -> dict[str, Any]:
        """For the job's row."""
        return asdict(self)

    def changed(self, **what: Any) -> Self:
        """With other frames, or other things asked of them."""
        return replace(self, **what, revision=self.revision + 1)
