"""Which frame of a job is rendered next, and up to how many samples. Decisions depend only on films at fixed sample counts, so
where a frame ends does not depend on which worker was faster.

Noisiest first: every frame gets the pilot's samples. Then, in rounds, what is left of the budget is distributed so that the
greatest noise becomes as small as possible (like water filling: the standard error falls with the square root of the samples,
so a frame of noise n with L samples needs L (n/v)^2 for v), but no round goes below half of the greatest noise, as the
estimates are rough. A round begins when all frames have what the one before gave them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from service.scheduling.jobs.active_frame import ActiveFrame
from service.scheduling.jobs.frame_queue import Turn, Turns

__all__ = ["Agenda", "shares"]

ROUNDS = ("breadth-first", "noisiest-first")  # orders that come back to a frame
PILOT = 16  # samples, before a frame's noise says where the rest is to be spent


class Agenda:
    """The order of a job's frames. `frames`: by their keys, in the shot's order."""

    def __init__(
        self, frames: Mapping[int, ActiveFrame], order: str, every: int, spp: int, goals: Mapping[int, int] | None = None
    ) -> None:
        """spp: of the shot, a pixel, on the average of its frames. goals: what an earlier round gave them."""
        self._frames = frames
        self._order = order
        self._spp = spp
        self._rank = dict(zip(frames, _ranks(len(frames), order, every), strict=True))
        self._pilot = max(1, min(PILOT, spp // 2))
        self._pending: set[int] = set()
        self._first: int | None = None
        self.forecast: float | None = None  # the noise at which the shot ends
        self.new_goals: dict[int, int] = {}  # to be written down before anything of them is handed out
        for key, frame in frames.items():
            if order == "noisiest-first":
                frame.ceiling = max((goals or {}).get(key, 1), 1)
                if not frame.is_over:
                    self._pending.add(key)
            elif order == "breadth-first":
                frame.ceiling = 1
        self.turns = Turns(frames, self.turn)

    @property
    def first(self) -> int | None:
        """The frame that goes before all others."""
        return self._first

    @first.setter
    def first(self, key: int | None) -> None:
        self.turns.note(*(each for each in (self._first, key) if each is not None and each in self._frames))
        self._first = key

    def next(self, kind: str) -> ActiveFrame | None:
        """The frame that workers of a kind render next; None where no frame that is ready has work."""
        return self.turns.ready(kind)

    def overtakes(self, frame: ActiveFrame, kind: str) -> bool:
        """Whether a frame goes on only because one whose turn it is is not prepared yet."""
        if self._order not in ROUNDS:
            return False
        first = self.turns.first_lacking(kind)
        return first is not None and first < self.turn(frame)

    def turn(self, frame: ActiveFrame) -> Turn:
        """The less, the sooner."""
        rank = self._rank[frame.key]
        before = 0.0 if frame.key == self.first else 1.0
        if self._order == "breadth-first":
            return before, frame.ceiling, rank
        if self._order == "noisiest-first":
            noise = 0.0 if frame.noise is None or frame.ceiling <= self._pilot else frame.noise
            return before, min(frame.ceiling, self._pilot + 1), -noise, rank
        return before, rank

    def passed(self, frame: ActiveFrame) -> bool:
        """All under a frame's ceiling is handed out. Whether it goes on at once."""
        top = {"breadth-first": frame.spp, "noisiest-first": self._pilot}.get(self._order, frame.ceiling)
        if frame.ceiling >= top:
            return False
        frame.rise_to(min(2 * frame.ceiling, top))
        return True

    def settled(self, frame: ActiveFrame) -> None:
        """Something of a frame came back, all of it is handed out, or it failed: it may be finished, or the last that a round
        waited for.

        Raises FilmWaits or FilmLost; then it is called again.
        """
        if not frame.is_over and frame.plan.done:
            frame.finish()
        if self._order != "noisiest-first" or (self.new_goals and not frame.is_over):
            return  # what a round gives frames that wait for it to begin says nothing of what they have
        if frame.is_over or (frame.ceiling >= self._pilot and frame.plan.has(frame.ceiling)):
            self._pending.discard(frame.key)
            if not self._pending:
                self._lay_out()

    def _lay_out(self) -> None:
        """Begin the next round, or end."""
        open = [f for f in self._frames.values() if not f.is_over]
        noises = [f.measured() for f in open]
        spent = sum(f.ceiling for f in self._frames.values() if f.state == "finished")
        budget = self._spp * sum(f.state != "failed" for f in self._frames.values()) - spent
        goals, self.forecast = shares([f.ceiling for f in open], noises, budget, max((f.spp for f in open), default=1))
        rising = [(f, goal) for f, goal in zip(open, goals, strict=True) if goal > f.ceiling]
        for frame, goal in rising:
            self.new_goals[frame.key] = goal
            self._pending.add(frame.key)
        if not rising:
            for frame in open:
                frame.finish()

    def begin_round(self) -> None:
        """The goals are written down: let them be rendered."""
        for key, goal in self.new_goals.items():
            self._frames[key].rise_to(goal)
        self.new_goals = {}


def shares(has: list[int], noise: list[float], budget: int, most: int) -> tuple[list[int], float | None]:
    """How many samples a pixel each frame is to have next, and the greatest noise that `budget` of them ends at.

    has, noise: of each frame, samples and relative noise. budget: all frames' samples together, those they have included.
    Frames whose noise is not known, or nothing at all, keep what they have.
    """
    known = [(h, n) for h, n in zip(has, noise, strict=True) if math.isfinite(n) and n > 0]
    if not known:
        return list(has), None
    low, high = 0.0, max(n for _, n in known)
    fixed = sum(has) - sum(h for h, _ in known)
    for _ in range(60):
        level = (low + high) / 2
        needs = fixed + sum(max(h, h * (n / level) ** 2) if level > 0 else math.inf for h, n in known)
        low, high = (low, level) if needs <= budget else (level, high)
    greatest = max(n for _, n in known)
    aim = max(high, greatest / 2)
    goals = [
        min(max(h, int(h * (n / aim) ** 2)), most) if math.isfinite(n) and n > 0 else h for h, n in zip(has, noise, strict=True)
    ]
    return goals, min(high, greatest)


def _ranks(count: int, order: str, every: int) -> Iterator[int]:
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
