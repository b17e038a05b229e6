"""What a person is told of a file's animations."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Clip"]


@dataclass(frozen=True)
class Clip:
    """An animation by its name, and the seconds of its first and its last key: before and after them it stands still."""

    name: str
    start: float
    end: float
