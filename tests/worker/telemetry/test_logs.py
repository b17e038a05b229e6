"""Tests of the worker's log."""

from __future__ import annotations

import logging

import pytest
import redis

from worker.telemetry.logs import _without_traceback


@pytest.mark.parametrize(
    "error", [redis.OutOfMemoryError("maxmemory"), redis.ConnectionError("refused"), BrokenPipeError("gone")]
)
def test_redis_errors_are_logged_as_one_line(error: Exception) -> None:
    record = logging.LogRecord(
        "celery", logging.CRITICAL, "", 1, "Connection to %s lost\n", ("broker",), (type(error), error, None)
    )
    assert _without_traceback(record)
    assert logging.Formatter().format(record) == f"Connection to broker lost ({error})"


def test_other_errors_keep_traceback() -> None:
    try:
        _ = 1 / 0
    except ZeroDivisionError as error:
        record = logging.LogRecord(
            "worker", logging.ERROR, "", 1, "preparing failed", (), (type(error), error, error.__traceback__)
        )
    assert _without_traceback(record)
    assert "Traceback" in logging.Formatter().format(record)
