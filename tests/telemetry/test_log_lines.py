"""Tests of log lines in JSON."""

from __future__ import annotations

import json
import logging
import subprocess
import sys
from typing import Any

import pytest

from telemetry.log_lines import JsonLines, about, ids
from tests.helpers import ROOT
from worker.telemetry.task_context import message_ids, traced_task


def line(record: logging.LogRecord) -> dict[str, Any]:
    text = JsonLines("worker").format(record)
    assert "\n" not in text
    found: dict[str, Any] = json.loads(text)
    return found


def record(message: str, *arguments: object, **more: Any) -> logging.LogRecord:
    made = logging.LogRecord("worker.tasks", logging.WARNING, "", 1, message, arguments, None)
    made.__dict__.update(more)
    return made


def test_a_line_has_what_it_is_about() -> None:
    with about(job="j", batch="b"), about(batch="c", frame=None):
        said = line(record("%s is\ngone", "Grüße", **ids(worker="w")))
    assert said["message"] == "Grüße is\ngone"
    assert (said["job"], said["batch"], said["worker"], said["level"], said["process"]) == ("j", "c", "w", "warning", "worker")
    assert said["time"].endswith("Z") and "frame" not in said
    assert "job" not in line(record("later"))


def test_an_exception_and_arguments_that_do_not_fit_are_one_object() -> None:
    try:
        _ = 1 / 0
    except ZeroDivisionError:
        said = line(logging.LogRecord("x", logging.ERROR, "", 1, "failed", (), sys.exc_info()))
    assert said["exception"]["type"] == "ZeroDivisionError"
    assert "Traceback" in said["exception"]["trace"]
    assert "%d" in line(record("%d things", "no"))["message"]
    assert line(record("odd \udcff"))["message"]


def test_requests_are_told_in_parts_and_without_what_may_be_secret() -> None:
    access = record('%s - "%s %s HTTP/%s" %d', "127.0.0.1:5", "GET", "/api/jobs?code=secret", "1.1", 200, name="uvicorn.access")
    said = line(access)
    assert (said["method"], said["path"], said["status"]) == ("GET", "/api/jobs", 200)


def test_a_task_is_about_what_its_message_names() -> None:
    seen: list[dict[str, Any]] = []

    def task(self: object, message: Any) -> None:
        seen.append(line(record("here")))

    traced_task(task, "x", int)(None, batch={"batch": "b", "job": "j", "frame": 4, "tile": [0, 0, 8, 8]})
    traced_task(task, "x", int)(None, scene="s")
    assert (seen[0]["batch"], seen[0]["job"], seen[0]["frame"]) == ("b", "j", 4)
    assert seen[1]["scene"] == "s"
    assert message_ids({"job": ["of", "another", "release"], "watch": "v"}) == {"view": "v"}


@pytest.mark.parametrize("ends", ["raise ValueError('x')", "t = threading.Thread(target=lambda: 1 / 0); t.start(); t.join()"])
def test_whatever_a_process_says_is_objects(ends: str) -> None:
    program = f"""
import logging, threading, warnings
logging.getLogger("uvicorn").addHandler(logging.StreamHandler())
from telemetry.log_lines import as_json
as_json("service")
logging.getLogger("uvicorn").error("a library's")
logging.getLogger("httpx").info("nobody asked")
warnings.warn("careful")
{ends}
"""
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, timeout=60)
    lines = [json.loads(each) for each in done.stderr.splitlines()]
    assert [each["logger"] for each in lines] == ["uvicorn", "py.warnings", "service"]
    assert lines[-1]["exception"]["type"] in ("ValueError", "ZeroDivisionError")
