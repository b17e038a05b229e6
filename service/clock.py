"""Deadlines as people write them."""

from __future__ import annotations

from datetime import datetime, timedelta

from worker.protocol.hours import local_now

__all__ = ["deadline_of"]

FURTHEST = timedelta(days=3660)


def deadline_of(text: str, now: datetime | None = None) -> float:
    """A deadline in unix time: an ISO time, or the next time that a clock says 08:00; in this machine's zone unless it says one.

    now: by this machine's clock, without a zone. Raises ValueError with a sentence.
    """
    # Without a zone it is a time of this machine's clocks, which may be put forward or back until then.
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
    """When a clock says that time again. Where it is put back it does so twice in a night."""
    for found in (today, today.replace(fold=1)):
        if found.timestamp() > now.timestamp() and (found > now or found.fold):
            return found
    return today + timedelta(days=1)
