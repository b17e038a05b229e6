"""Tests of parsing the weekly hours in which a worker may render, and of whether it may render at a moment."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from datetime import datetime
from pathlib import Path

import pytest

from protocol.hours import Hours
from tests.helpers import code_of

NIGHTS = "Mon-Fri 19:00-07:00, Sat-Sun"


@pytest.mark.parametrize(
    ("text", "moment", "are_now"),
    [
        (NIGHTS, "2026-03-02T06:59", False),  # Monday morning: Sunday has ended, and Monday's night has not begun
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
        ("Sat 08:00-08:00", "2026-03-08T07:59", True),  # 24 hours
    ],
)
def test_includes_working_hours(text: str, moment: str, are_now: bool) -> None:
    assert Hours.parse(text).includes(datetime.fromisoformat(moment)) is are_now


@pytest.mark.parametrize(
    "text", ["", "Mondays", "Mon 19-07", "Mon-", "Fre", "25:00-26:00", "10:70-11:00", "Mon,,Tue", "24:30-01:00"]
)
def test_invalid_hours_are_rejected(text: str) -> None:
    with pytest.raises(ValueError) as error:
        Hours.parse(text)
    assert code_of(error.value) in ("hours-malformed", "hours-day-unknown", "hours-time-invalid")


ZONES = """
import os, shutil, subprocess, sys, time
from pathlib import Path
from protocol.hours import local_now
zone = Path("/etc/localtime")
subprocess.run(["mount", "--bind", "/usr/share/zoneinfo/Asia/Tokyo", os.path.realpath(zone)], check=True)
before = local_now()
subprocess.run(["umount", os.path.realpath(zone)], check=True)
subprocess.run(["mount", "--bind", "/usr/share/zoneinfo/America/Lima", os.path.realpath(zone)], check=True)
print(round((before - local_now()).total_seconds() / 3600))
"""


def test_changed_time_zone_takes_effect() -> None:
    """A changed time zone of the machine takes effect without a restart.

    The zone is changed in a mount namespace, so that the zone of the machine that runs the test stays unchanged.
    """
    zones = [Path("/usr/share/zoneinfo", name) for name in ("Asia/Tokyo", "America/Lima")]
    if not all(zone.exists() for zone in zones) or not Path("/etc/localtime").exists() or shutil.which("unshare") is None:
        pytest.skip("this machine has no zones")
    environment = {key: value for key, value in os.environ.items() if key != "TZ"}
    done = subprocess.run(
        ["unshare", "--mount", sys.executable, "-c", ZONES], capture_output=True, text=True, timeout=60, env=environment
    )
    if done.returncode:
        pytest.skip(f"mounts are not to be had here: {done.stderr[-200:]}")
    assert done.stdout.strip() == "14"


@pytest.mark.parametrize(
    ("evening", "hours"), [("2026-03-28T20:00+01:00", 6), ("2026-10-24T20:00+02:00", 8), ("2026-05-02T20:00+02:00", 7)]
)
def test_clock_change_does_not_interrupt_working_night(evening: str, hours: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a night of a clock change, a worker renders from the beginning to the end of its hours without interruption.

    The night is one hour shorter or longer than others.
    """
    with monkeypatch.context() as here:
        here.setenv("TZ", "CET-1CEST,M3.5.0,M10.5.0/3")
        time.tzset()
        begin = datetime.fromisoformat(evening).timestamp()
        night = Hours.parse("23:00-06:00")
        worked = [minute for minute in range(14 * 60) if night.includes(datetime.fromtimestamp(begin + 60 * minute))]
    time.tzset()
    assert worked == list(range(180, 180 + 60 * hours))
