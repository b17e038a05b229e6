"""Frames that are prepared for views."""

from __future__ import annotations

import pytest

from service.viewing import asked_frames
from service.viewing.asked_frames import AskedFrames


def test_what_nobody_answers_is_forgotten(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = AskedFrames()
    for message in ("handed out", "in a hand", "lost", "answered"):
        asked.add(message, f"frame {message}", "scene")
    asked.forget(["answered", "never asked"])
    asked.review()
    assert len(asked) == 3, "they may still come"
    monkeypatch.setattr(asked_frames, "PATIENCE_S", -1.0)
    asked.review({"handed out": None}, {"in a hand"})
    assert len(asked) == 2
    assert asked.about("lost") == ("", "")
    assert asked.about("in a hand") == ("frame in a hand", "scene")
