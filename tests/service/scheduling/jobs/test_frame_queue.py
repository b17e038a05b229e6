"""Tests that the frame queue returns the same frames as a search through all frames."""

from __future__ import annotations

import random
from types import SimpleNamespace
from typing import Any

from service.scheduling.jobs.frame_queue import FrameQueue
from service.scheduling.jobs.lazy_heap import MAX_OUTDATED, LazyHeap


class _Frame(SimpleNamespace):
    """The attributes of a frame that the queue reads."""

    def __init__(self, key: int) -> None:
        super().__init__(key=key, rank=0, is_over=False, is_idle=False, is_preparing=False, compiled={}, own={}, guided=set())

    def lacks_guide(self, kind: str) -> bool:
        return kind not in self.guided


def test_frame_queue_equals_linear_search() -> None:
    chance = random.Random(5)
    frames: dict[int, Any] = {key: _Frame(key) for key in range(40)}
    turns = FrameQueue(frames, lambda frame: (frame.rank, frame.key))  # type: ignore[attr-defined]
    for _ in range(500):
        frame = frames[chance.randrange(40)]
        name = chance.choice(["is_over", "is_idle", "is_preparing"])
        setattr(frame, name, chance.random() < 0.3)
        frame.rank = chance.randrange(4)
        frame.compiled = {kind: "scene" for kind in "ab" if chance.random() < 0.5}
        frame.own = frame.compiled if chance.random() < 0.5 else {}
        frame.guided = {kind for kind in "ab" if chance.random() < 0.7}
        turns.mark_changed(frame.key)
        for kind in "ab":
            open = [f for f in frames.values() if not f.is_over and not f.is_idle]
            ready = sorted((f.rank, f.key) for f in open if kind in f.compiled and kind in f.guided)
            lacking = sorted((f.rank, f.key) for f in open if kind not in f.compiled)
            unguided = sorted((f.rank, f.key) for f in open if kind in f.compiled and kind not in f.guided)
            first = turns.ready_frames(kind)
            assert (None if first is None else (first.rank, first.key)) == (ready[0] if ready else None)  # type: ignore[attr-defined]
            assert turns.first_unprepared(kind) == min(lacking + unguided, default=None)
            free = [key for _, key in lacking if not frames[key].is_preparing]
            assert [f.key for f in turns.frames_to_prepare(kind, 3)] == free[:3]
            assert [f.key for f in turns.frames_without_guide(kind, 3)] == [key for _, key in unguided[:3]]
            assert turns.count_without_guide(kind) == len(unguided)
            before = (chance.randrange(5), chance.randrange(40))
            assert turns.count_ready_before(kind, before, 4) == min(4, sum(turn < before for turn in ready))
        assert {f.key for f in turns.preparing_frames()} == {key for key, f in frames.items() if f.is_preparing}
        assert {f.key for f in turns.frames_with_own_scene()} == {key for key, f in frames.items() if f.own}


def test_outdated_entries_are_removed() -> None:
    """A frame whose sort key changes often behind the first frame leaves few entries in the heap."""
    heap: LazyHeap[int] = LazyHeap()
    heap.put(0, -1)
    for n in range(1000):
        heap.put(1, n % 7)
    assert heap.first_keys(2) == [0, 1]
    assert len(heap._heap) <= 2 * len(heap) + MAX_OUTDATED
