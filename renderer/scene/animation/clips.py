"""Animation clips of a scene file: their names, their times, and the sentence that lists a file's clips for users."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from renderer.sentences import Sentence

__all__ = ["Clip", "other_clips_sentence"]

_MAX_LISTED = 8


@dataclass(frozen=True)
class Clip:
    """An animation clip: its name, and the times of its first and last key in seconds.

    The animated values are constant before the first and after the last key.
    """

    name: str
    start: float
    end: float


def other_clips_sentence(file: str, clips: Sequence[Clip]) -> str:
    """Returns the sentence for users that names the clip shown (the file's first) and lists its other clips."""
    others = [clip.name[:60] for clip in clips[1:]]
    shown, listed = repr(clips[0].name[:60]), others[:_MAX_LISTED]
    if len(others) <= _MAX_LISTED:
        return Sentence(
            "animation-clip-chosen",
            "{file} shows the animation {name}. Other clips: {others}.",
            file=file,
            name=shown,
            others=listed,
        )
    return Sentence(
        "animation-clip-chosen-of-many",
        "{file} shows the animation {name}. Other clips: {others} and {count} more.",
        file=file,
        name=shown,
        others=listed,
        count=len(others) - _MAX_LISTED,
    )
