"""Tests of the artifacts that a slot makes for clients, such as denoised pictures and motion vectors.

After any error, the slot sends an event of failure and becomes free.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, replace
from types import SimpleNamespace
from typing import Any

import pytest

from protocol.contract import DenoiseFrame, GuideScene, PrepareFrames
from renderer.sentences import Sentence
from renderer.settings import RenderSettings, View
from worker.exchange.errors import LinkError, WorkError
from worker.machine.status import SlotBoard
from worker.work import derived_artifacts
from worker.work.derived_artifacts import ArtifactTask

WORK = DenoiseFrame("w1", "job", 4, 8, 8)
TASK_TEXT = Sentence("task-denoise-picture", "denoise the picture")
TASK = SimpleNamespace(request=SimpleNamespace(delivery_info={}))


@pytest.fixture
def worker() -> Any:
    return SimpleNamespace(name="attic", board=SlotBoard(1))


def aside(make: Callable[..., dict[str, Any]]) -> ArtifactTask[DenoiseFrame]:
    return ArtifactTask(DenoiseFrame.from_json, make, "made", "failed", "denoise", TASK_TEXT)


def test_slot_reports_artifact_in_progress(worker: Any) -> None:
    seen: list[Any] = []

    def make(worker: Any, work: DenoiseFrame) -> dict[str, Any]:
        seen.append(worker.board.read()[0][0])
        return {"sha256": work.job}

    event = aside(make).event(TASK, worker, asdict(WORK))
    assert event == {"type": "made", "work": "w1", "worker": "attic", "sha256": "job"}
    assert seen == [{"denoise": "job", "frame": 4}]
    assert worker.board.read()[0] == [{}]


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (WorkError(Sentence("picture-too-large", "The picture is too large.")), "picture-too-large"),
        (LinkError("no answer"), "worker-task-failed"),
        (OSError("no space left"), "worker-task-without-room"),
        (ZeroDivisionError("a fault"), "worker-task-error"),
    ],
)
def test_every_error_is_answered(worker: Any, error: Exception, code: str) -> None:
    def make(*_: Any) -> dict[str, Any]:
        raise error

    event = aside(make).event(TASK, worker, asdict(WORK))
    assert event == {"type": "failed", "work": "w1", "worker": "attic", "error": event["error"]}
    assert event["error"].code == code
    assert event["error"].params.get("task", TASK_TEXT).code == "task-denoise-picture"
    assert worker.board.read()[0] == [{}]


def test_message_of_other_release_is_answered(worker: Any) -> None:
    event = aside(lambda *_: {}).event(TASK, worker, {"work": "w1", "job": 7})
    assert (event["type"], event["work"]) == ("failed", "w1")


def test_a_guide_of_another_release_is_left_out() -> None:
    moment = PrepareFrames("", "", "s", [4], "b" * 64, {}, turntable=2.0)
    guide = GuideScene("kind", "b" * 64, RenderSettings(8, 8, View((0, 0, 4), (0, 0, 0))), moment, "c" * 64)
    message = json.loads(json.dumps(replace(WORK, guide=guide).to_json()))
    assert DenoiseFrame.from_json(message) == replace(WORK, guide=guide)
    message["guide"]["settings"]["integrator"] = "of a later release"
    assert DenoiseFrame.from_json(message) == WORK
    assert "guide" not in WORK.to_json()


def test_artifact_that_kills_process_fails(worker: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(derived_artifacts, "count_deaths", lambda *_: derived_artifacts.DEATHS_ALLOWED)
    event = aside(lambda *_: {}).event(TASK, worker, asdict(WORK))
    assert event["error"].code == "worker-died-during-task"
    assert event["error"].params == {"count": 3, "task": TASK_TEXT}
