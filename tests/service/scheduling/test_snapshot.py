"""Tests of the engine's snapshots, which other threads read, and of when these threads are notified of a new one."""

from __future__ import annotations

import time
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from service.events import Events, ItemChanged
from service.scheduling import snapshot
from service.scheduling.snapshot import JobNumbers, Snapshot, SnapshotHolder


def job(samples: int, state: str = "running") -> Any:
    about = {
        "samples": samples,
        "shot": None,
        "tally": SimpleNamespace(numbers=dict, states=lambda: ({}, ())),
        "state": state,
        "bad_samples": 0,
        "progress": 0.5,
        "active_s": 1.0,
        "eta_s": None,
        "samples_per_s": 0.0,
        "current_noise": None,
    }
    about |= {"handed_back": None, "slots_wanted": 0, "expected": None, "unforeseen": None}
    return SimpleNamespace(**about)


def look(numbers: Any) -> Snapshot:
    return Snapshot(fault=None, jobs=numbers)


def test_change_event_follows_snapshot(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[tuple[str, str, int]] = []
    events = Events()
    board = SnapshotHolder(events)
    events.subscribe(ItemChanged, lambda event: told.append((event.kind, event.id, board.latest.jobs[event.id].samples)))
    board.record_change("job", "a")
    board.publish({"a": job(1)}, look)
    board.record_change("job", "a")
    board.publish({"a": job(2)}, look)
    assert told == [("job", "a", 1)], "numbers are renewed ten times a second"
    monkeypatch.setattr(snapshot, "NUMBERS_EVERY_S", 0.0)
    board.publish({"a": job(2)}, look)
    board.publish({"a": job(3)}, look)
    assert told == [("job", "a", 1), ("job", "a", 2)], "what did not change is not told"


def test_state_change_is_published_at_once() -> None:
    told: list[str] = []
    events = Events()
    board = SnapshotHolder(events)
    events.subscribe(ItemChanged, lambda event: told.append(board.latest.jobs[event.id].state))
    for state in ("running", "paused"):
        board.record_change("job", "a")
        board.publish({"a": job(1, state)}, look)
    assert told == ["running", "paused"]


def numbers(state: str) -> JobNumbers:
    return JobNumbers.from_job(job(1, state))


@pytest.mark.parametrize(
    ("view", "why"),
    [
        (Snapshot(fault=None), None),
        (Snapshot(), "is starting"),
        (Snapshot(fault="Redis does not answer."), "Redis"),
        (
            Snapshot(fault=None, jobs={"a": numbers("running")}, waits={"a": "Waits: locked."}),
            "The scheduler is stalled. Waits: locked.",
        ),
        (Snapshot(fault=None, jobs={"a": numbers("running"), "b": numbers("running")}, waits={"a": "Waits: locked."}), None),
        (Snapshot(fault=None, jobs={"a": numbers("paused")}, waits={"a": "Waits: locked."}), None),
        (Snapshot(fault=None, waits={"a job that cannot be taken up": "Waits: locked."}), "Waits: locked."),
    ],
)
def test_readiness_reasons(view: Snapshot, why: str | None) -> None:
    view = replace(view, made=time.monotonic())
    assert (view.unready_reason is None) == (why is None)
    assert why is None or why in (view.unready_reason or "")


def test_blocked_engine_is_not_ready() -> None:
    assert "The scheduler has been busy with one step for 6" in (
        Snapshot(fault=None, made=time.monotonic() - 60.0).unready_reason or ""
    )
