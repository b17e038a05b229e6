"""What a look found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["Finding", "Level", "fault", "fine", "note"]

Level = Literal["fine", "note", "fault"]


@dataclass(frozen=True)
class Finding:
    """level: fine; note: it works, and could be better; fault: it does not work, or something was lost.

    about: what was looked at. says: a sentence. do: what to do next, where there is something.
    """

    level: Level
    about: str
    says: str
    do: str = ""


def fine(about: str, says: str) -> Finding:
    """All is well."""
    return Finding("fine", about, says)


def note(about: str, says: str, do: str = "") -> Finding:
    """It works, and could be better."""
    return Finding("note", about, says, do)


def fault(about: str, says: str, do: str) -> Finding:
    """It does not work, or something was lost."""
    return Finding("fault", about, says, do)
