"""However a farm ends, no process of it is left."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import psutil
import pytest

from tests.helpers import start_farm, stop_farm, wait_until

pytestmark = pytest.mark.farm


def gone(processes: list[psutil.Process]) -> bool:
    return not any(p.is_running() and p.status() != psutil.STATUS_ZOMBIE for p in processes)


@pytest.mark.parametrize(
    ("signals", "seconds", "slots"),
    [
        ([signal.SIGINT], 10, 2),
        ([signal.SIGINT, signal.SIGINT], 8, 2),
        ([signal.SIGTERM], 10, 0),  # for what is below, these two are as one Ctrl-C: a farm without a worker starts sooner
        pytest.param([signal.SIGHUP], 10, 0, marks=pytest.mark.long),
        ([signal.SIGKILL], 8, 2),
    ],
    ids=["Ctrl-C", "Ctrl-C twice", "SIGTERM", "SIGHUP", "SIGKILL"],
)
def test_nothing_is_left(tmp_path: Path, signals: list[signal.Signals], seconds: float, slots: int) -> None:
    farm = start_farm(tmp_path / "data", slots)
    try:
        family = farm.family()
        assert len(family) >= (6 if slots else 3), f"up, redis, service, worker and two slots: {family}"
        begun = time.monotonic()
        for number in signals:
            farm.process.send_signal(number)
            time.sleep(0.1)
        code = farm.process.wait(seconds)
        wait_until(lambda: gone(family), 2, f"all have ended: {family}")
        assert time.monotonic() - begun < seconds + 2
        if signals[0] != signal.SIGKILL:
            assert code == 0
            assert not (farm.data / "farm.json").exists()
            assert "Nothing is left running" in farm.log.read_text()
    finally:
        stop_farm(farm)
