"""A child that stays: it answers until nobody asks, and what it cannot do is told as that of any bounded child."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import pytest

from renderer.errors import SceneError
from worker.exchange.errors import WorkError
from worker.work import standing
from worker.work.bounded import Bounds, Send
from worker.work.standing import Answer, Standing

BOUNDS = Bounds(1 << 30, 5.0, (SceneError,), "truck.glb")


def counts() -> Answer:
    asked = 0

    def answer(request: dict[str, Any], send: Send) -> None:
        nonlocal asked
        asked += 1
        if request.get("crash"):
            os._exit(7)
        if request.get("wrong"):
            raise SceneError("the truck has no wheels")
        send({"asked": asked, "by": os.getpid(), **request})

    return answer


def begun(left: Path, idle_s: float = 5.0) -> Standing:
    return Standing(counts, left.touch, BOUNDS, idle_s)


def test_it_answers_again_and_again_and_leaves_when_nobody_asks(tmp_path: Path) -> None:
    child, said = begun(tmp_path / "left", 0.3), []
    for word in ("one", "two" * 100_000):
        assert child.ask({"word": word}, said.append)
    assert [(each["asked"], each["word"][:3]) for each in said] == [(1, "one"), (2, "two")]
    assert said[0]["by"] == said[1]["by"] != os.getpid()
    deadline = time.monotonic() + 5
    while not (tmp_path / "left").exists() and time.monotonic() < deadline:
        time.sleep(0.02)
    assert not child.ask({}, said.append), "it has left"
    assert child.is_over
    child.end()


def test_it_stays_while_what_it_said_is_dealt_with(tmp_path: Path) -> None:
    """A frame's files wait in the child's room for a service that starts anew."""
    child = begun(tmp_path / "left", 0.2)
    left = []

    def slowly(message: dict[str, Any]) -> None:
        time.sleep(0.8)
        left.append((tmp_path / "left").exists())

    assert child.ask({"word": "one"}, slowly)
    assert child.ask({"word": "two"}, slowly)
    assert left == [False, False]
    child.end()


def test_what_fails_is_a_sentence_and_ends_it(tmp_path: Path) -> None:
    for request, sentence in (({"crash": True}, "truck.glb could not be prepared"), ({"wrong": True}, "the truck has no wheels")):
        child = begun(tmp_path / "left")
        with pytest.raises(WorkError, match=sentence):
            child.ask(request, lambda message: None)
        assert child.is_over
    assert not (tmp_path / "left").exists()


def test_a_large_one_stays_for_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(standing, "LARGE", 1)
    child = begun(tmp_path / "left")
    assert child.ask({}, lambda message: None)
    deadline = time.monotonic() + 20
    while not (tmp_path / "left").exists():  # it looks once it has heard that its answer was taken
        assert time.monotonic() < deadline
        time.sleep(0.02)
    assert not child.ask({}, lambda message: None)
