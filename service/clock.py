"""Interfaces of clocks, which tests replace by simulated clocks, and parsing of deadlines."""

from __future__ import annotations

from datetime import datetime, timedelta
from typing import Protocol

from protocol.hours import local_now
from renderer.sentences import Sentence

__all__ = ["Clock", "WorkClock", "deadline_of"]

MAX_DEADLINE = timedelta(days=3660)


class Clock(Protocol):
    """Interface of a monotonic clock. The `time` module implements it; tests substitute a simulated clock."""

    def monotonic(self) -> float:
        """Returns seconds since an arbitrary moment."""


class WorkClock(Clock, Protocol):
    """Interface of a clock that also measures the processor time of threads."""

    def thread_time(self) -> float:
        """Returns the processor time that the current thread has used, in seconds."""


def deadline_of(text: str, now: datetime | None = None) -> float:
    """Returns the Unix time of a deadline. text: an ISO time, or a time of day such as 08:00, meaning its next occurrence.

    Times without a zone are in this machine's zone. now: the present as local time without a zone; None: read from the clock.
    Raises ValueError with a sentence for a malformed, past or too distant time.
    """
    # Without a zone, so that changes to and from daylight saving time are taken into account.
    now = now or local_now()
    text = text.strip()
    try:
        if len(text) <= 5 and ":" in text:
            hour, minute = map(int, text.split(":"))
            found = _next_occurrence(now.replace(hour=hour, minute=minute, second=0, microsecond=0, fold=0), now)
        else:
            found = datetime.fromisoformat(text)
        seconds = found.timestamp()
    except (ValueError, OverflowError, OSError):
        raise ValueError(
            Sentence(
                "deadline-malformed",
                "{text} is not a time; give 08:00, 2026-05-01T08:00 or 2026-05-01T08:00+02:00",
                text=repr(text[:60]),
            )
        ) from None
    if seconds <= now.timestamp():
        raise ValueError(Sentence("deadline-in-past", "{time} has passed already; give a later time", time=text))
    if seconds > now.timestamp() + MAX_DEADLINE.total_seconds():
        raise ValueError(Sentence("deadline-too-far", "{time} is more than ten years from now; give an earlier time", time=text))
    return seconds


def _next_occurrence(today: datetime, now: datetime) -> datetime:
    """Returns the next occurrence of a time of day after `now`. today: that time on the day of `now`.

    In the night in which clocks are set back, one time of day can occur twice; each occurrence counts.
    """
    for found in (today, today.replace(fold=1)):
        if found.timestamp() > now.timestamp() and (found > now or found.fold):
            return found
    return today + timedelta(days=1)
