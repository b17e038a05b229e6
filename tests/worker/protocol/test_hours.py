"""Hours of a week as people write them."""

from __future__ import annotations

from datetime import datetime

import pytest

from worker.protocol.hours import Hours

NIGHTS = "Mon-Fri 19:00-07:00, Sat-Sun"


@pytest.mark.parametrize(
    ("text", "moment", "are_now"),
    [
        (NIGHTS, "2026-03-02T06:59", False),  # a Monday: Sunday is over, and Monday's night has not begun
        (NIGHTS, "2026-03-02T18:59", False),
        (NIGHTS, "2026-03-02T19:00", True),
        (NIGHTS, "2026-03-03T06:59", True),
        (NIGHTS, "2026-03-03T07:00", False),
        (NIGHTS, "2026-03-07T06:00", True),
        (NIGHTS, "2026-03-07T12:00", True),
        (NIGHTS, "2026-03-08T23:59", True),
        ("22:00-06:00", "2026-03-02T05:59", True),
        ("22:00-06:00", "2026-03-02T12:00", False),
        ("9:00-17:30", "2026-03-02T17:29", True),
        ("9:00-17:30", "2026-03-02T17:30", False),
        ("Fri-Mon", "2026-03-02T12:00", True),
        ("Fri-Mon", "2026-03-03T00:00", False),
        ("sat", "2026-03-07T00:00", True),
        ("Sat 20:00-24:00", "2026-03-07T23:59", True),
        ("Sat 20:00-24:00", "2026-03-08T00:00", False),
        ("Sat 08:00-08:00", "2026-03-08T07:59", True),  # once around the clock
    ],
)
def test_when_it_works(text: str, moment: str, are_now: bool) -> None:
    assert Hours.parse(text).are_now(datetime.fromisoformat(moment)) is are_now


@pytest.mark.parametrize(
    "text", ["", "Mondays", "Mon 19-07", "Mon-", "Fre", "25:00-26:00", "10:70-11:00", "Mon,,Tue", "24:30-01:00"]
)
def test_what_is_none(text: str) -> None:
    with pytest.raises(ValueError, match=r"is no (part of a week|day|time)"):
        Hours.parse(text)
