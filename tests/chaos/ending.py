"""Checks that a stopped farm ends in time, logs its end, and leaves no process behind."""

from __future__ import annotations

import signal
import time
from collections.abc import Sequence

import psutil

from tests.helpers import Farm, wait_until

__all__ = ["ends_by"]


def ends_by(farm: Farm, signals: Sequence[signal.Signals], seconds: float, slots: int) -> None:
    """Sends signals to the farm's main process, and asserts that all processes of the farm end within `seconds`.

    After signals other than SIGKILL, the farm must also exit with 0 and log that nothing is left. slots: expected number of
    slots.
    """
    family = farm.family()
    assert len(family) >= (4 + slots if slots else 3), f"up, redis, service, and with slots a worker: {family}"
    begun = time.monotonic()
    for number in signals:
        farm.process.send_signal(number)
        time.sleep(0.1)
    code = farm.process.wait(seconds)
    wait_until(lambda: _gone(family), 2, f"all have ended: {family}")
    assert time.monotonic() - begun < seconds + 2
    if signals[0] != signal.SIGKILL:
        assert code == 0
        assert not (farm.data / "farm.json").exists()
        assert "Nothing is left running" in farm.log.read_text()


def _gone(processes: list[psutil.Process]) -> bool:
    return not any(p.is_running() and p.status() != psutil.STATUS_ZOMBIE for p in processes)
