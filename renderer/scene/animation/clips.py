"""What a person is told of a file's animations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

__all__ = ["Clip", "others_of"]

_NAMED = 8


@dataclass(frozen=True)
class Clip:
    """An animation by its name, and the seconds of its first and its last key: before and after them it stands still."""

    name: str
    start: float
    end: float


def others_of(file: str, clips: Sequence[Clip]) -> str:
    """The sentence that names what else a file of several animations could show than the first."""
    others = [clip.name[:60] for clip in clips[1:]]
    more = f" and {len(others) - _NAMED} more" if len(others) > _NAMED else ""
    return f"{file}: shows the animation {clips[0].name[:60]!r}; as its clip you may choose {', '.join(others[:_NAMED])}{more}."
