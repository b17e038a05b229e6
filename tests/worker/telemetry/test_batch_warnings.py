"""Tests of the warnings that a slot logs while it renders a batch, and of the durations of the batch's steps."""

from __future__ import annotations

import logging
import time

from worker.telemetry.batch_warnings import WarningHandler, collect_warnings, step


def test_warnings_are_collected_and_limited() -> None:
    log, listener = logging.getLogger("a library"), WarningHandler()
    logging.getLogger().addHandler(listener)
    try:
        log.warning("before")
        with collect_warnings() as heard:
            log.info("as ever")
            try:
                _ = 1 / 0
            except ZeroDivisionError:
                log.exception("the %s is away", "service")
            for number in range(50):
                log.warning("%d %s", number, "x" * 1000)
        log.warning("behind")
    finally:
        logging.getLogger().removeHandler(listener)
    said = heard.result_fields()
    assert said["lines"][0] == "error: the service is away (ZeroDivisionError: division by zero)"
    assert len(said["lines"]) == 10 and max(map(len, said["lines"])) == 300
    assert "took" not in said


def test_step_durations_are_summed() -> None:
    with collect_warnings() as heard:
        for _ in range(2):
            with step("open scene"):
                time.sleep(0.02)
    assert heard.result_fields()["took"]["open scene"] >= 0.04
    with collect_warnings() as heard:
        pass
    assert heard.result_fields() == {}
