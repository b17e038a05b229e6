"""Tests of the recorded speeds of workers: one mean per minute over the slots that render, during the last hour."""

from __future__ import annotations

from protocol.contract import WorkerReport
from service.scheduling.fleet.speeds import INTERVALS_KEPT, Speeds


def report(name: str, slots_at_work: int, speed: float) -> WorkerReport:
    current = [{"batch": "b"}] * slots_at_work + [{}, {"batch": "c", "compiling": True}]
    return WorkerReport(name, "host", 1, slots_at_work + 2, "cpu", "kind", "ready", 0.0, speed, current)


def test_speeds_are_averaged_per_minute() -> None:
    speeds = Speeds(0.0)
    speeds.add_reports([report("a", 2, 100.0)], 1.0)
    speeds.add_reports([report("a", 0, 100.0)], 30.0)
    speeds.add_reports([report("a", 1, 100.0)], 40.0)
    assert speeds.speeds_by_worker == {"a": (150.0,)}, "reports without work do not count"
    speeds.add_reports([report("a", 3, 100.0), report("b", 1, 7.0)], 61.0)
    assert speeds.speeds_by_worker == {"a": (150.0, 300.0), "b": (7.0,)}
    speeds.add_reports([report("a", 0, 100.0)], 121.0)
    assert speeds.speeds_by_worker["a"] == (150.0, 300.0, 0.0)


def test_speeds_cover_last_hour() -> None:
    speeds = Speeds(0.0)
    for minute in range(200):
        speeds.add_reports([report("a", 1, float(minute))], 60.0 * minute)
    assert speeds.speeds_by_worker["a"] == tuple(float(minute) for minute in range(200 - INTERVALS_KEPT, 200))
    for minute in range(200, 270):
        speeds.add_reports([report("b", 1, 1.0)], 60.0 * minute)
    assert set(speeds.speeds_by_worker) == {"b"}
