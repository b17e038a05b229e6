"""Tests that errors are attributed to Redis, the database or a job, and that the failed step is retried in time."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable

import pytest
import redis
from sqlalchemy import exc

from renderer.errors import SettingsError
from service.errors import FilmLost, FilmUnavailable, OutOfSpace, QueueError, Unavailable
from service.scheduling.faults.bulkhead import Bulkheads, Step
from service.store.disk_space import disk_full_error
from tests.service.scheduling.fake_clock import FakeClock

FULL = OutOfSpace("The disk is full.")
MALFORMED = exc.DatabaseError("INSERT", {}, sqlite3.DatabaseError("database disk image is malformed"))
ROW = exc.IntegrityError("INSERT", {}, sqlite3.IntegrityError("UNIQUE"))


@pytest.fixture
def clock() -> FakeClock:
    return FakeClock()


def raising(error: Exception) -> Callable[[], None]:
    def action() -> None:
        raise error

    return action


@pytest.mark.parametrize("error", [redis.ConnectionError("away"), QueueError("away")])
def test_redis_errors_are_not_attributed_to_jobs(clock: FakeClock, error: Exception) -> None:
    heads = Bulkheads(clock)
    with pytest.raises(type(error)):
        heads.run("job", Step.HAND_OUT, raising(error))
    assert heads.may_render("job")


def test_temporary_fault_is_retried_after_a_second(clock: FakeClock) -> None:
    heads = Bulkheads(clock)
    done: list[str] = []
    assert not heads.run("job", Step.RESULTS, raising(FilmUnavailable("The film is locked.")))
    assert heads.waiting_reasons() == {"job": "Waits: the film is locked."}
    assert not heads.may_render("job")
    assert not heads.run("job", Step.RESULTS, lambda: done.append("too early"))
    assert heads.run("other", Step.RESULTS, lambda: done.append("other"))
    clock.now += 1.1
    assert heads.run("job", Step.RESULTS, lambda: done.append("job"))
    assert done == ["other", "job"]
    assert heads.waiting_reasons() == {}
    assert heads.may_render("job")


def test_slow_failure_is_retried_less_often(clock: FakeClock) -> None:
    heads = Bulkheads(clock)

    def lock() -> None:
        clock.now += 0.25
        raise FilmUnavailable("locked")

    heads.run("job", Step.RESULTS, lock)
    clock.now += 2.0
    assert not heads.run("job", Step.RESULTS, lambda: None)
    clock.now += 0.6
    assert heads.run("job", Step.RESULTS, lambda: None)


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (disk_full_error(), "The service's disk is full. Delete scenes or jobs that are no longer needed."),
        (Unavailable("The database is locked.", advice="Try again."), "The database is locked."),
        (MALFORMED, "The database cannot be used (the database file is malformed)."),
    ],
)
def test_database_errors_delay_all_database_steps(clock: FakeClock, error: Exception, sentence: str) -> None:
    heads = Bulkheads(clock)
    heads.run("job", Step.RECORD, raising(error), needs_database=True)
    assert heads.database_fault == sentence
    assert not heads.run("other", Step.RECORD, lambda: None, needs_database=True)
    assert heads.run("other", Step.RESULTS, lambda: None), "films go on"
    assert heads.may_render("job")
    clock.now += 1.1
    assert heads.run("other", Step.RECORD, lambda: None, needs_database=True)
    assert heads.database_fault is None


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (FilmLost("The film is damaged. Do this."), "The film is damaged. Do this."),
        (
            SettingsError("there is no field wavelengths"),
            "This job cannot continue: there is no field wavelengths. Make a new one.",
        ),
        (ROW, "IntegrityError"),
        (KeyError("tile"), "KeyError: 'tile'"),
        (RecursionError(), "RecursionError"),
    ],
)
def test_other_errors_are_attributed_to_job(clock: FakeClock, error: Exception, sentence: str) -> None:
    heads = Bulkheads(clock)
    assert not heads.run("job", Step.CHANGE, raising(error), needs_database=True)
    assert sentence in heads.verdicts["job"].error
    assert not heads.may_render("job")
    assert not heads.run("job", Step.RESULTS, lambda: None)
    assert heads.database_fault is None


def test_verdict_is_kept_until_stored(clock: FakeClock) -> None:
    heads = Bulkheads(clock)
    heads.give_verdict("job", "It failed.", "rayfarm render")
    ended: list[str] = []
    heads.end_failed_jobs(lambda id, verdict: raising(FULL)())
    heads.end_failed_jobs(lambda id, verdict: ended.append("too early"))
    clock.now += 1.1
    heads.end_failed_jobs(lambda id, verdict: ended.append(f"{id} {verdict.error} {verdict.reproduce}"))
    heads.end_failed_jobs(lambda id, verdict: ended.append("twice"))
    assert ended == ["job It failed. rayfarm render"]
    assert heads.may_render("job")


def test_verdict_that_cannot_be_applied_is_dropped(clock: FakeClock) -> None:
    heads = Bulkheads(clock)
    heads.give_verdict("job", "It failed.")
    heads.end_failed_jobs(lambda id, verdict: raising(ValueError("a row that cannot be read"))())
    assert heads.verdicts == {}
