"""Clocks as their users see them, and parsing of deadlines."""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import Protocol

from protocol.hours import local_now

__all__ = ["Clock", "WorkClock", "deadline_of"]

FURTHEST = timedelta(days=3660)


class Clock(Protocol):
    """A clock that never goes back. The module `time` is one, and a test has its own."""

    def monotonic(self) -> float:
        """Returns seconds since some moment."""


class WorkClock(Clock, Protocol):
    """A clock that also measures work."""

    def thread_time(self) -> float:
        """Returns this thread's processor time in seconds."""


def deadline_of(text: str, now: datetime | None = None) -> float:
    """Returns a deadline as Unix time, from an ISO time or a time of day such as 08:00, which is its next occurrence.

    Times without a zone are in this machine's zone. now: the local time without a zone; by default the present.
    Raises ValueError, with a sentence, for malformed, past or too distant times.
    """
    # Without a zone, so that changes to and from daylight saving time are taken into account.
    now = now or local_now()
    text = text.strip()
    try:
        if len(text) <= 5 and ":" in text:
            hour, minute = map(int, text.split(":"))
            found = _next(now.replace(hour=hour, minute=minute, second=0, microsecond=0, fold=0), now)
        else:
            found = datetime.fromisoformat(text)
        seconds = found.timestamp()
    except (ValueError, OverflowError, OSError):
        raise ValueError(f"{text[:60]!r} is no time; give 08:00, 2026-05-01T08:00 or 2026-05-01T08:00+02:00") from None
    if seconds <= now.timestamp():
        raise ValueError(f"{text} has passed already")
    if seconds > now.timestamp() + FURTHEST.total_seconds():
        raise ValueError(f"{text} is more than ten years from now")
    return seconds


def _next(today: datetime, now: datetime) -> datetime:
    """Returns the next occurrence of a time of day; when clocks are set back, it occurs twice in a night."""
    for found in (today, today.replace(fold=1)):
        if found.timestamp() > now.timestamp() and (found > now or found.fold):
            return found
    return today + timedelta(days=1)
