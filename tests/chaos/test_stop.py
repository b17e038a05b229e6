"""Tests that no process remains, however a farm ends. test_digest.py tests the case of a single Ctrl-C."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest

from tests.chaos.ending import ends_by
from tests.helpers import start_farm, stop_farm

pytestmark = pytest.mark.long


@pytest.mark.parametrize(
    ("signals", "seconds", "slots"),
    [
        ([signal.SIGINT, signal.SIGINT], 8, 2),
        # Equivalent to one Ctrl-C for these tests; without a worker a farm starts sooner.
        ([signal.SIGTERM], 10, 0),
        ([signal.SIGHUP], 10, 0),
        ([signal.SIGKILL], 8, 2),  # tests/rayfarm/test_supervisor.py covers the parts without --long
    ],
    ids=["Ctrl-C twice", "SIGTERM", "SIGHUP", "SIGKILL"],
)
def test_nothing_is_left(tmp_path: Path, signals: list[signal.Signals], seconds: float, slots: int) -> None:
    farm = start_farm(tmp_path / "data", slots)
    try:
        ends_by(farm, signals, seconds, slots)
    finally:
        stop_farm(farm)
