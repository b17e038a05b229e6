"""Tests that requests of live views for frames are forgotten if no worker answers them."""

from __future__ import annotations

import pytest

from service.viewing import pending_frames
from service.viewing.pending_frames import PendingFrames


def test_unanswered_requests_expire(monkeypatch: pytest.MonkeyPatch) -> None:
    pending = PendingFrames()
    for message in ("handed out", "in a hand", "lost", "answered"):
        pending.add(message, f"frame {message}", "scene")
    pending.remove(["answered", "never pending"])
    pending.remove_expired()
    assert len(pending) == 3, "they may still come"
    monkeypatch.setattr(pending_frames, "ANSWER_TIMEOUT_S", -1.0)
    pending.remove_expired({"handed out": None}, {"in a hand"})
    assert len(pending) == 2
    assert pending.key_and_scene("lost") == ("", "")
    assert pending.key_and_scene("in a hand") == ("frame in a hand", "scene")
