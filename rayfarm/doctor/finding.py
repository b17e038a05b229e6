"""Results of checks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ["Finding", "Level", "fact", "fault", "fine", "note_finding"]

Level = Literal["fine", "fact", "note", "fault"]


@dataclass(frozen=True)
class Finding:
    """Result of a check. level: fine; fact: neither good nor bad; note: could be better; fault: does not work, or data was lost.

    about: subject of the check. says: the result, as a sentence. do: what to do next, if anything.
    """

    level: Level
    about: str
    says: str
    do: str = ""


def fine(about: str, says: str) -> Finding:
    """Returns a finding of level "fine"."""
    return Finding("fine", about, says)


def fact(about: str, says: str) -> Finding:
    """Returns a finding of level "fact": how this machine is, which is neither good nor bad."""
    return Finding("fact", about, says)


def note_finding(about: str, says: str, advice: str = "") -> Finding:
    """Returns a finding of level "note": it works, but could be better."""
    return Finding("note", about, says, advice)


def fault(about: str, says: str, advice: str) -> Finding:
    """Returns a finding of level "fault": it does not work, or data was lost."""
    return Finding("fault", about, says, advice)
