"""Tests of parsing deadlines."""

from __future__ import annotations

import time
from collections.abc import Iterator
from datetime import datetime

import pytest

from service.clock import deadline_of
from tests.helpers import code_of

EVENING = datetime(2026, 3, 1, 22, 30, 15)


@pytest.fixture(autouse=True)
def in_the_middle_of_europe(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Sets a Central European time zone: clocks go forward at 2026-03-29 02:00, and back at 2026-10-25 03:00."""
    with monkeypatch.context() as here:
        here.setenv("TZ", "CET-1CEST,M3.5.0,M10.5.0/3")
        time.tzset()
        yield
    time.tzset()


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("08:00", "2026-03-02T08:00+01:00"),
        ("8:00", "2026-03-02T08:00+01:00"),
        ("22:31", "2026-03-01T22:31+01:00"),
        ("22:30", "2026-03-02T22:30+01:00"),
        ("2026-03-01T23:00", "2026-03-01T23:00+01:00"),
        ("2026-03-02T08:00:30Z", "2026-03-02T09:00:30+01:00"),
        ("2026-03-05", "2026-03-05T00:00+01:00"),
    ],
)
def test_deadline_is_parsed(text: str, found: str) -> None:
    assert deadline_of(text, EVENING) == datetime.fromisoformat(found).timestamp()


@pytest.mark.parametrize(
    ("now", "text", "found"),
    [
        ("2026-03-28T22:30", "08:00", "2026-03-29T08:00+02:00"),
        ("2026-10-24T22:30", "08:00", "2026-10-25T08:00+01:00"),
        ("2026-03-01T22:30", "2026-07-01T08:00", "2026-07-01T08:00+02:00"),
        ("2026-07-01T22:30", "2026-12-24", "2026-12-24T00:00+01:00"),
        ("2026-03-28T22:30", "2026-03-29T08:00+01:00", "2026-03-29T08:00+01:00"),
        ("2026-03-29T01:50", "02:30", "2026-03-29T03:30+02:00"),  # an hour that does not exist on that night
        ("2026-03-29T03:20", "02:30", "2026-03-30T02:30+02:00"),
        ("2026-10-25T01:50", "02:30", "2026-10-25T02:30+02:00"),
        ("2026-10-25T02:50", "02:30", "2026-10-25T02:30+01:00"),
        ("2026-10-25T02:50 again", "02:30", "2026-10-26T02:30+01:00"),
        ("2026-10-25T02:10 again", "02:30", "2026-10-25T02:30+01:00"),
    ],
)
def test_deadline_across_clock_change(now: str, text: str, found: str) -> None:
    at = datetime.fromisoformat(now.removesuffix(" again")).replace(fold=int(now.endswith("again")))
    assert deadline_of(text, at) == datetime.fromisoformat(found).timestamp()


@pytest.mark.parametrize(
    ("text", "codes"),
    [
        ("tomorrow", "deadline-malformed"),
        ("25:00", "deadline-malformed"),
        ("-1:00", "deadline-malformed"),
        ("", "deadline-malformed"),
        ("0001-01-01T00:00:00+23:00", "deadline-malformed deadline-in-past"),
        ("2026-03-01T22:30", "deadline-in-past"),
        ("2046-03-01", "deadline-too-far"),
    ],
)
def test_invalid_deadline_is_rejected(text: str, codes: str) -> None:
    with pytest.raises(ValueError) as error:
        deadline_of(text, EVENING)
    assert code_of(error.value) in codes.split()
