"""Tests of pending frame requests of views."""

from __future__ import annotations

import pytest

from service.viewing import pending_frames
from service.viewing.pending_frames import PendingFrames


def test_what_nobody_answers_is_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    pending = PendingFrames()
    for message in ("handed out", "in a hand", "lost", "answered"):
        pending.add(message, f"frame {message}", "scene")
    pending.forget(["answered", "never pending"])
    pending.review()
    assert len(pending) == 3, "they may still come"
    monkeypatch.setattr(pending_frames, "ANSWER_TIMEOUT_S", -1.0)
    pending.review({"handed out": None}, {"in a hand"})
    assert len(pending) == 2
    assert pending.about("lost") == ("", "")
    assert pending.about("in a hand") == ("frame in a hand", "scene")
