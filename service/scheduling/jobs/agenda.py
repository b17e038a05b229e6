"""Selects the next frame of a job, and the number of samples up to which the frame is rendered.

Decisions depend only on films at fixed sample counts, so the final samples of a frame do not depend on the workers' speeds.

Order `noisiest-first`: every frame is first rendered with a few pilot samples per pixel. Then the remaining budget is
distributed in rounds to minimize the maximum noise, as in water filling: the standard error falls with the square root of the
samples, so a frame of noise n with L samples needs L (n/v)^2 samples for noise v. As the estimates are rough, no round aims
below half of the maximum noise. A round begins when all frames have the samples of the previous one.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from service.scheduling.jobs.active_frame import ActiveFrame
from service.scheduling.jobs.frame_queue import FrameQueue, SortKey

__all__ = ["FrameOrder", "goals_of_frames"]

MULTI_PASS_ORDERS = ("breadth-first", "noisiest-first")  # orders that render a frame in several passes
PILOT_SAMPLES = 16  # samples per pixel before a frame's noise determines its share of the budget


class FrameOrder:
    """Order in which a job's frames are rendered."""

    def __init__(
        self, frames: Mapping[int, ActiveFrame], order: str, every: int, spp: int, goals: Mapping[int, int] | None = None
    ) -> None:
        """Creates the order of these frames, which are given by key in the order of the shot.

        order: name of the order. every: step n of the order `every-nth`. spp: mean samples per pixel over the shot's frames.
        goals: samples per pixel by frame key, from an earlier round of the order `noisiest-first`.
        """
        self._frames = frames
        self._order = order
        self._spp = spp
        self._rank = dict(zip(frames, _frame_ranks(len(frames), order, every), strict=True))
        self._pilot = max(1, min(PILOT_SAMPLES, spp // 2))
        self._pending: set[int] = set()
        self._first: int | None = None
        self.forecast: float | None = None  # expected final noise of the shot
        self.new_goals: dict[int, int] = {}  # to be stored before any of their samples are handed out
        for key, frame in frames.items():
            if order == "noisiest-first":
                frame.ceiling = max((goals or {}).get(key, 1), 1)
                if not frame.is_over:
                    self._pending.add(key)
            elif order == "breadth-first":
                frame.ceiling = 1
        self.turns = FrameQueue(frames, self.sort_key)

    @property
    def first_key(self) -> int | None:
        """Key of the frame that is rendered before all others; None if there is none."""
        return self._first

    @first_key.setter
    def first_key(self, key: int | None) -> None:
        self.turns.mark_changed(*(each for each in (self._first, key) if each is not None and each in self._frames))
        self._first = key

    def next_frame(self, kind: str) -> ActiveFrame | None:
        """Returns the next frame for workers of this kind; None if no prepared frame has work."""
        return self.turns.ready_frames(kind)

    def is_out_of_order(self, frame: ActiveFrame, kind: str) -> bool:
        """Returns True if a frame is rendered now only because an earlier frame of the order is not prepared yet.

        Always returns False for orders that render each frame in a single pass.
        """
        if self._order not in MULTI_PASS_ORDERS:
            return False
        first = self.turns.first_unprepared(kind)
        return first is not None and first < self.sort_key(frame)

    def sort_key(self, frame: ActiveFrame) -> SortKey:
        """Returns the sort key of a frame. The frame with the smallest key is rendered first."""
        rank = self._rank[frame.key]
        before = 0.0 if frame.key == self.first_key else 1.0
        if self._order == "breadth-first":
            return before, frame.ceiling, rank
        if self._order == "noisiest-first":
            noise = 0.0 if frame.noise is None or frame.ceiling <= self._pilot else frame.noise
            return before, min(frame.ceiling, self._pilot + 1), -noise, rank
        return before, rank

    def raise_ceiling(self, frame: ActiveFrame) -> bool:
        """Raises a frame's ceiling after all samples below it were dispatched.

        The ceiling is the number of samples per pixel up to which batches may be dispatched. Returns False if it cannot rise.
        """
        top = {"breadth-first": frame.spp, "noisiest-first": self._pilot}.get(self._order, frame.ceiling)
        if frame.ceiling >= top:
            return False
        frame.raise_ceiling(min(2 * frame.ceiling, top))
        return True

    def finish_if_complete(self, frame: ActiveFrame) -> None:
        """Finishes a frame if it is complete. In the order `noisiest-first`, the last frame of a round plans the next round.

        Call this after a batch of the frame has returned, after all batches of the frame were dispatched, or after the frame
        has failed. Raises FilmUnavailable or FilmLost; then call it again.
        """
        if not frame.is_over and frame.plan.is_done:
            frame.finish()
        if self._order != "noisiest-first" or (self.new_goals and not frame.is_over):
            return  # frames waiting for the next round are not complete yet
        if frame.is_over or (frame.ceiling >= self._pilot and frame.plan.every_tile_has(frame.ceiling)):
            self._pending.discard(frame.key)
            if not self._pending:
                self._plan_round()

    def _plan_round(self) -> None:
        """Computes the sample goals of the next round of `noisiest-first`. Finishes all frames if no samples remain."""
        open = [f for f in self._frames.values() if not f.is_over]
        noises = [f.measured_noise() for f in open]
        spent = sum(f.ceiling for f in self._frames.values() if f.state == "finished")
        budget = self._spp * sum(f.state != "failed" for f in self._frames.values()) - spent
        goals, self.forecast = goals_of_frames([f.ceiling for f in open], noises, budget, max((f.spp for f in open), default=1))
        rising = [(f, goal) for f, goal in zip(open, goals, strict=True) if goal > f.ceiling]
        for frame, goal in rising:
            self.new_goals[frame.key] = goal
            self._pending.add(frame.key)
        if not rising:
            for frame in open:
                frame.finish()

    def begin_round(self) -> None:
        """Starts the next round of the order `noisiest-first`. Call it after the goals of that round were stored."""
        for key, goal in self.new_goals.items():
            self._frames[key].raise_ceiling(goal)
        self.new_goals = {}


def goals_of_frames(samples: list[int], noise: list[float], budget: int, maximum: int) -> tuple[list[int], float | None]:
    """Returns the next goal of each frame in samples per pixel, and the expected maximum noise or None.

    The expected maximum noise is that after `budget` samples. samples, noise: samples per pixel and relative noise of each
    frame. budget: samples per pixel summed over all frames, including existing ones. maximum: largest goal of a frame. Frames
    of unknown or zero noise get no more samples.
    """
    known = [(h, n) for h, n in zip(samples, noise, strict=True) if math.isfinite(n) and n > 0]
    if not known:
        return list(samples), None
    low, high = 0.0, max(n for _, n in known)
    fixed = sum(samples) - sum(h for h, _ in known)
    for _ in range(60):
        level = (low + high) / 2
        needs = fixed + sum(max(h, h * (n / level) ** 2) if level > 0 else math.inf for h, n in known)
        low, high = (low, level) if needs <= budget else (level, high)
    greatest = max(n for _, n in known)
    aim = max(high, greatest / 2)
    goals = [
        min(max(h, int(h * (n / aim) ** 2)), maximum) if math.isfinite(n) and n > 0 else h
        for h, n in zip(samples, noise, strict=True)
    ]
    return goals, min(high, greatest)


def _frame_ranks(count: int, order: str, every: int) -> Iterator[int]:
    if order == "every-nth":
        chosen: dict[int, None] = {}
        while every >= 1:
            chosen |= dict.fromkeys(range(0, count, every))
            every //= 2
    elif order == "centre-out":
        chosen = dict.fromkeys(sorted(range(count), key=lambda i: abs(2 * i - count + 1)))
    else:
        chosen = dict.fromkeys(range(count))
    place = {frame: rank for rank, frame in enumerate(chosen)}
    return (place[i] for i in range(count))
