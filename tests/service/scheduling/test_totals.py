"""A job's totals are what its frames come to, however they change; and only those that changed are counted again."""

from __future__ import annotations

import random
from types import SimpleNamespace
from typing import Any

from service.scheduling.totals import Totals


class Frame(SimpleNamespace):
    """Counts how often it was asked."""

    asked = 0

    @property
    def is_over(self) -> bool:
        type(self).asked += 1
        return self.state in ("finished", "failed")


def test_totals_follow_the_frames() -> None:
    chance = random.Random(7)
    frames: dict[int, Any] = {key: Frame(key=key, samples=0, target_samples=100, state="queued") for key in range(0, 600, 2)}
    totals = Totals(frames).renewed()
    assert (totals.samples, totals.target, totals.over) == (0, 300 * 100, 0)
    Frame.asked = 0
    for _ in range(200):
        frame = frames[2 * chance.randrange(300)]
        frame.samples, frame.state = chance.randrange(100), chance.choice(["queued", "running", "finished", "failed"])
        frame.on_change(frame.key)
        frame.on_change(frame.key)
        totals.renewed()
    assert Frame.asked == 200
    left = [frame for frame in frames.values() if frame.state != "failed"]
    assert totals.samples == sum(frame.samples for frame in frames.values())
    assert totals.target == 100 * len(left)
    assert totals.over == sum(frame.is_over for frame in frames.values())
