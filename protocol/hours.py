"""Text form of a worker's working hours, such as "Mon-Fri 19:00-07:00, Sat-Sun", in its machine's local time."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass
from datetime import datetime, timedelta

from renderer.sentences import Sentence

__all__ = ["Hours", "local_now"]

DAYS = ("mon", "tue", "wed", "thu", "fri", "sat", "sun")
MAX_PERIODS = 50
_PART = re.compile(r"(?:(?P<days>[a-z]{3}(?:\s*-\s*[a-z]{3})?))?\s*(?:(?P<begin>\d{1,2}:\d\d)\s*-\s*(?P<end>\d{1,2}:\d\d))?")


def local_now() -> datetime:
    """Returns the current local time. Reads the machine's time zone again, which a process otherwise caches at its start."""
    time.tzset()
    return datetime.now()


@dataclass(frozen=True)
class Hours:
    """Working hours: intervals that repeat every week.

    parts: for each interval the days on which it begins (0: Monday), and its first and last minute of the day. If the last
    minute is not after the first, the interval continues into the next day.
    """

    parts: tuple[tuple[frozenset[int], int, int], ...]

    @classmethod
    def parse(cls, text: str) -> Hours:
        """Parses comma-separated intervals, such as "Mon-Fri 19:00-07:00, Sat-Sun".

        Days without times mean the whole days; times without days mean every day. Raises ValueError with a sentence.
        """
        pieces = text.lower().split(",")
        if len(pieces) > MAX_PERIODS:
            raise ValueError(Sentence("hours-too-many", "hours may have at most {most} parts; give fewer", most=MAX_PERIODS))
        return cls(tuple(_parse_part(piece.strip()) for piece in pieces))

    def includes(self, now: datetime) -> bool:
        """Returns True if `now` is within the hours."""
        minute, day = 60 * now.hour + now.minute, now.weekday()
        before = (now - timedelta(days=1)).weekday()
        for days, begin, end in self.parts:
            if end > begin:
                if day in days and begin <= minute < end:
                    return True
            elif (day in days and minute >= begin) or (before in days and minute < end):
                return True
        return False


def _parse_part(text: str) -> tuple[frozenset[int], int, int]:
    found = _PART.fullmatch(text)
    if found is None or not text:
        raise ValueError(
            Sentence(
                "hours-malformed",
                "{text} is not a valid interval of a week; give hours as Mon-Fri 19:00-07:00, Sat-Sun",
                text=repr(text[:40]),
            )
        )
    begin, end = (_minute(found[name]) if found[name] else None for name in ("begin", "end"))
    return _days(found["days"]), begin or 0, 24 * 60 if end is None else end


def _days(text: str | None) -> frozenset[int]:
    if text is None:
        return frozenset(range(7))
    names = [name.strip() for name in text.split("-")]
    unknown = [name for name in names if name not in DAYS]
    if unknown:
        raise ValueError(
            Sentence("hours-day-unknown", "{day} is not a day; days are Mon, Tue, Wed, Thu, Fri, Sat, Sun", day=repr(unknown[0]))
        )
    first, last = DAYS.index(names[0]), DAYS.index(names[-1])
    return frozenset((first + i) % 7 for i in range((last - first) % 7 + 1))


def _minute(text: str) -> int:
    hour, minute = map(int, text.split(":"))
    if minute > 59 or hour > 24 or (hour == 24 and minute):
        raise ValueError(Sentence("hours-time-invalid", "{time} is not a time of day; give 00:00 to 24:00", time=text))
    return 60 * hour + minute
