"""Tests that a job's totals equal the sums over its frames after arbitrary changes.

Only the numbers of changed frames are read again.
"""

from __future__ import annotations

import random
from types import SimpleNamespace
from typing import Any

from service.scheduling.jobs.lazy_heap import MAX_OUTDATED
from service.scheduling.jobs.totals import RunningMaximum, Totals


class Frame(SimpleNamespace):
    """A substitute for a frame that counts how often its numbers are read."""

    asked = 0

    @property
    def is_over(self) -> bool:
        type(self).asked += 1
        return self.state in ("finished", "failed")


def frame_of(key: int) -> Frame:
    return Frame(key=key, samples=0, target_samples=100, bad_samples=0, noise=None, state="queued")


def test_totals_equal_sums_over_frames() -> None:
    chance = random.Random(7)
    frames: dict[int, Any] = {key: frame_of(key) for key in range(0, 600, 2)}
    totals = Totals(frames).updated()
    assert (totals.samples, totals.target, totals.over) == (0, 300 * 100, 0)
    Frame.asked = 0
    for _ in range(200):
        frame = frames[2 * chance.randrange(300)]
        frame.samples, frame.state = chance.randrange(100), chance.choice(["queued", "running", "finished", "failed"])
        frame.bad_samples, frame.noise = chance.randrange(3), chance.choice([None, chance.random()])
        totals.mark_changed(frame.key)
        totals.mark_changed(frame.key)
        totals.updated()
        noises = [each.noise for each in frames.values() if each.state != "failed"]
        assert totals.noise.value == (None if None in noises else max(noises))
    assert Frame.asked == 200
    left = [frame for frame in frames.values() if frame.state != "failed"]
    assert totals.samples == sum(frame.samples for frame in frames.values())
    assert totals.target == 100 * len(left)
    assert totals.over == sum(frame.is_over for frame in frames.values())
    assert totals.bad_samples == sum(frame.bad_samples for frame in frames.values())


def test_maximum_is_known_once_all_values_are() -> None:
    greatest, chance = RunningMaximum(), random.Random(3)
    values: dict[int, float | None] = {}
    assert greatest.value is None
    for _ in range(2000):
        key = chance.randrange(12)
        if chance.random() < 0.2:
            values.pop(key, None)
            greatest.remove(key)
        else:
            values[key] = None if chance.random() < 0.05 else chance.randrange(5) / 4
            greatest.set(key, values[key])
        known = list(values.values())
        assert greatest.value == (None if None in known or not known else max(known))  # type: ignore[type-var]
    assert len(greatest._known._heap) <= 2 * 12 + MAX_OUTDATED + 1, "what was does not pile up"
