"""Tests that a clock set forward by mistake causes no deletion of data that cannot be restored."""

from __future__ import annotations

import time

import pytest

from service.access.keys import Keys
from service.access.roles import OWNER, Role
from service.maintenance import retention
from service.maintenance.retention import DAY_S, Retention, Rules, WallClock
from service.store.database import connect
from service.store.models import Key
from tests.service.conftest import new_sqlite


def test_clock_set_forward_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, ahead = WallClock(), [0.0]
    real = time.time
    monkeypatch.setattr(time, "time", lambda: real() + ahead[0])
    assert abs(clock.jumped_s()) < 1
    ahead[0] = 40 * DAY_S
    assert clock.jumped_s() > 39 * DAY_S
    assert abs(clock.jumped_s()) < 1, "from then on it is believed"
    ahead[0] = 0.0
    assert clock.jumped_s() < -39 * DAY_S


@pytest.mark.skipif(not hasattr(time, "CLOCK_BOOTTIME"), reason="this system does not count the time for which it sleeps")
def test_standby_is_no_clock_jump(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, woken = WallClock(), time.time() + 8 * 3600
    slept_to = time.clock_gettime(time.CLOCK_BOOTTIME) + 8 * 3600
    monkeypatch.setattr(time, "time", lambda: woken)
    monkeypatch.setattr(time, "clock_gettime", lambda _: slept_to)  # time.monotonic was suspended meanwhile
    assert abs(clock.jumped_s()) < 1


def test_retention_waits_after_clock_jump_and_start(monkeypatch: pytest.MonkeyPatch) -> None:
    pauses: list[float] = []
    jumps = iter([0.0, 40 * DAY_S, 0.0])
    looked: list[int] = []
    kept = Retention.__new__(Retention)
    kept._rules = Rules(films_days=1)

    class Stopping:
        def wait(self, pause_s: float) -> bool:
            pauses.append(pause_s)
            return len(pauses) > 3

    kept._stopping = Stopping()  # type: ignore[assignment]
    monkeypatch.setattr(WallClock, "jumped_s", lambda _: next(jumps))
    monkeypatch.setattr(Retention, "deletable_items", lambda *_: [])
    monkeypatch.setattr(Retention, "carry_out", lambda *_: looked.append(len(pauses)))
    kept._run()
    assert pauses[:3] == [retention.FIRST_RUN_AFTER_S, retention.EVERY_S, retention.EVERY_S]
    assert looked == [1, 3]


def test_token_survives_clock_ahead_for_a_day(tmp_path: object, monkeypatch: pytest.MonkeyPatch) -> None:
    engine, sessions = connect(new_sqlite(tmp_path))
    keys = Keys(sessions)
    secret, row = keys.create("token", OWNER, Role.SUBMIT, "nightly", 3600.0)
    real = time.time
    with monkeypatch.context() as ahead:
        ahead.setattr(time, "time", lambda: real() + DAY_S)
        assert keys.find(secret) is None, "it is over, by this clock"
        keys.create("token", OWNER, Role.SUBMIT, "another")
    assert keys.find(secret) is not None
    with sessions() as session:
        assert session.get(Key, row.id) is not None
    engine.dispose()
