"""Tests of the order in which a shot's frames are rendered, and of how samples are divided among frames of different noise."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from service.scheduling.jobs.agenda import PILOT_SAMPLES, FrameOrder, goals_of_frames


class Frame:
    """A simulated frame, whose noise is proportional to 1 / sqrt(samples). Requested samples are rendered immediately."""

    def __init__(self, key: int, grain: float = 1.0, spp: int = 1 << 20) -> None:
        self.key, self.grain, self.spp = key, grain, spp
        self.ceiling, self.state, self.is_idle, self.noise = spp, "queued", False, None
        self.compiled = {"kind": "scene"}
        self.own: dict[str, object] = {}
        self.is_preparing, self.lacking = False, set[str]()  # kinds for which it lacks its path guide
        self.on_change: Callable[[int], None] = lambda key: None
        self.plan = SimpleNamespace(is_done=False, every_tile_has=lambda samples: True)

    @property
    def is_over(self) -> bool:
        return self.state in ("finished", "failed")

    def lacks_guide(self, kind: str) -> bool:
        return kind in self.lacking

    def measured_noise(self) -> float:
        self.noise = self.grain / math.sqrt(self.ceiling)
        return self.noise

    def raise_ceiling(self, ceiling: int) -> None:
        self.ceiling = ceiling
        self.on_change(self.key)

    def finish(self) -> None:
        self.state = "finished"


def frame_order(order: str, frames: list[Frame], spp: int = 64, every: int = 8) -> Any:
    made: Any = {frame.key: frame for frame in frames}
    plan = FrameOrder(made, order, every, spp)
    for frame in frames:
        frame.on_change = plan.turns.mark_changed
    return plan


def render_to_end(frames: list[Frame], spp: int) -> Any:
    """Renders all frames completely in the order `noisiest-first`, and returns the order object.

    spp: mean samples per pixel over the frames.
    """
    plan = frame_order("noisiest-first", frames, spp)
    rounds = 0
    while not all(frame.is_over for frame in frames):
        for frame in frames:
            while plan.raise_ceiling(frame):
                pass
            plan.finish_if_complete(frame)
        plan.begin_round()
        rounds += 1
        assert rounds < 50
    return plan


def test_pilot_samples_then_noisiest_frames() -> None:
    frames = [Frame(0, 0.1), Frame(1, 1.0), Frame(2, 4.0)]
    plan = render_to_end(frames, 256)
    assert frames[0].ceiling == PILOT_SAMPLES, "quiet as it is"
    assert sum(frame.ceiling for frame in frames) <= 3 * 256
    assert sum(frame.ceiling for frame in frames) > 0.99 * 3 * 256, "the budget is spent"
    assert frames[2].measured_noise() == pytest.approx(frames[1].measured_noise(), rel=0.05), "equal noise"
    assert plan.forecast == pytest.approx(frames[2].measured_noise(), rel=0.05), "as it was foretold"


def test_failed_frame_releases_its_samples() -> None:
    frames = [Frame(0), Frame(1), Frame(2)]
    frames[1].state = "failed"
    render_to_end(frames, 100)
    assert [frame.ceiling for frame in frames if frame.state != "failed"] == [100, 100]


@given(
    st.lists(st.tuples(st.integers(1, 1000), st.floats(1e-4, 10.0)), min_size=1, max_size=20),
    st.floats(1.0, 50.0),
)
def test_goals_respect_budget_and_existing_samples(frames: list[tuple[int, float]], times: float) -> None:
    has, noise = [h for h, _ in frames], [n for _, n in frames]
    budget = int(sum(has) * times)
    goals, forecast = goals_of_frames(has, noise, budget, 1 << 20)
    assert all(goal >= h for goal, h in zip(goals, has, strict=True))
    assert sum(goals) <= budget
    assert forecast is not None and forecast <= max(noise) * (1 + 1e-9)
    aim = max(forecast, max(noise) / 2)
    for h, n, goal in zip(has, noise, goals, strict=True):
        assert n * math.sqrt(h / goal) >= min(n, aim) * (1 - 1e-6), "nobody gets more than the level asks for"


def test_goals_are_unchanged_without_known_noise() -> None:
    assert goals_of_frames([4, 4], [math.inf, 0.0], 100, 1000) == ([4, 4], None)


def test_every_nth_order_then_frames_between() -> None:
    frames = [Frame(key) for key in range(9)]
    plan = frame_order("every-nth", frames, every=6)
    order = sorted(frames, key=plan.sort_key)
    assert [frame.key for frame in order] == [0, 6, 3, 1, 2, 4, 5, 7, 8]


def test_breadth_first_raises_ceiling_after_dispatch() -> None:
    frames = [Frame(key, spp=6) for key in range(2)]
    plan = frame_order("breadth-first", frames, 6)
    seen = []
    while (frame := plan.next_frame("kind")) is not None:
        seen.append((frame.key, frame.ceiling))
        if not plan.raise_ceiling(frame):
            frame.is_idle = True
            plan.turns.mark_changed(frame.key)
    assert seen == [(0, 1), (1, 1), (0, 2), (1, 2), (0, 4), (1, 4), (0, 6), (1, 6)]


def test_unprepared_frames_wait_and_are_listed_in_order() -> None:
    frames = [Frame(key) for key in range(5)]
    for key in (1, 3):
        frames[key].compiled = {}
    plan = frame_order("centre-out", frames)
    plan.first_key = 3
    assert [frame.key for frame in plan.turns.frames_to_prepare("kind", 5)] == [3, 1]
    assert plan.next_frame("kind").key == 2
    assert plan.next_frame("another") is None


def test_frames_wait_for_their_path_guides() -> None:
    frames = [Frame(key) for key in range(4)]
    frames[0].compiled, frames[1].lacking, frames[2].lacking = {}, {"kind"}, {"kind"}
    plan = frame_order("breadth-first", frames)
    assert plan.next_frame("kind").key == 3
    assert plan.is_out_of_order(frames[3], "kind")
    assert [frame.key for frame in plan.turns.frames_to_prepare("kind", 5)] == [0]
    assert [frame.key for frame in plan.turns.frames_without_guide("kind", 5)] == [1, 2]
    assert plan.turns.count_without_guide("kind") == 2 and not plan.turns.count_without_guide("another")
    frames[1].lacking = set()
    plan.turns.mark_changed(1)
    assert plan.next_frame("kind").key == 1
    assert plan.turns.first_unprepared("kind") == plan.sort_key(frames[0])
