"""Tests that the frame queue returns the same frames as a search through all frames."""

from __future__ import annotations

import random
from types import SimpleNamespace
from typing import Any

import pytest

from service.scheduling.jobs.frame_queue import FrameQueue


@pytest.mark.long
def test_frame_queue_equals_linear_search() -> None:
    chance = random.Random(5)
    frames: dict[int, Any] = {
        key: SimpleNamespace(key=key, is_over=False, is_idle=False, is_preparing=False, compiled={}, own={}, rank=0)
        for key in range(40)
    }
    turns = FrameQueue(frames, lambda frame: (frame.rank, frame.key))  # type: ignore[attr-defined]
    for _ in range(3000):
        frame = frames[chance.randrange(40)]
        name = chance.choice(["is_over", "is_idle", "is_preparing"])
        setattr(frame, name, chance.random() < 0.3)
        frame.rank = chance.randrange(4)
        frame.compiled = {kind: "scene" for kind in "ab" if chance.random() < 0.5}
        frame.own = frame.compiled if chance.random() < 0.5 else {}
        turns.mark_changed(frame.key)
        for kind in "ab":
            open = [f for f in frames.values() if not f.is_over and not f.is_idle]
            ready = sorted((f.rank, f.key) for f in open if kind in f.compiled)
            lacking = sorted((f.rank, f.key) for f in open if kind not in f.compiled)
            first = turns.ready_frames(kind)
            assert (None if first is None else (first.rank, first.key)) == (ready[0] if ready else None)  # type: ignore[attr-defined]
            assert turns.first_unprepared(kind) == (lacking[0] if lacking else None)
            free = [key for _, key in lacking if not frames[key].is_preparing]
            assert [f.key for f in turns.frames_to_prepare(kind, 3)] == free[:3]
            before = (chance.randrange(5), chance.randrange(40))
            assert turns.count_ready_before(kind, before, 4) == min(4, sum(turn < before for turn in ready))
        assert {f.key for f in turns.preparing_frames()} == {key for key, f in frames.items() if f.is_preparing}
        assert {f.key for f in turns.frames_with_own_scene()} == {key for key, f in frames.items() if f.own}
    assert all(len(line._heap) < 300 for line in turns._ready.values()), "what was does not pile up"
