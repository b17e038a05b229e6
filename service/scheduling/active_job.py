"""A job that is being rendered: its film, its plan, how fast it goes and what went wrong with its batches."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from renderer import film as film_math
from renderer.settings import RenderSettings
from service.scheduling.plan import FramePlan, Range
from service.store.coverage import Coverage
from service.store.films import Film
from service.store.models import Job

__all__ = ["FAILURES_ALLOWED", "LOSSES_ALLOWED", "ActiveJob", "Trouble"]

FAILURES_ALLOWED = 3
LOSSES_ALLOWED = 5
SMALLEST_BATCH_S = 0.04
SMOOTHING = 0.3


@dataclass
class Trouble:
    """What happened to a batch that did not succeed."""

    since: float = field(default_factory=time.monotonic)
    losses: int = 0
    workers: list[str] = field(default_factory=list)  # on which it failed, one entry a failure
    error: str = ""
    reproduce: str | None = None


class ActiveJob:
    """One job in the hands of the scheduler. Only the engine's thread changes it; others read its numbers."""

    def __init__(self, row: Job, film: Film, compiled: dict[str, str]) -> None:
        """`compiled`: kind of worker -> SHA-256 of the scene compiled for it."""
        assert row.settings is not None and row.spp is not None
        self.id = row.id
        self.scene = row.scene
        self.created = row.created
        self.film = film
        self.compiled = compiled
        self.settings = RenderSettings.from_json(row.settings)
        self.state = row.state
        self.priority = row.priority
        self.kind = row.kind
        self.seconds = row.seconds
        self.active_s = row.active_s
        self.started = row.started is not None
        self.served = 0  # when it was given a batch last, as a place in the order of all batches
        self.frame = 0
        self.plan = self._plan(row.spp, row.noise)
        self.bad_samples = film.bad_samples(self.frame)[0]
        self.trouble: dict[Range, Trouble] = {}
        self.handed_back: str | None = None  # why a worker gave a batch back, where none was rendered since
        self.rests_until = 0.0
        self._unsettled: list[Range] = []  # batches that came back, and that the plan has not looked at yet
        self.samples_per_s = 0.0  # of the whole farm on this job, over the wall clock
        self._pixel_cost = 0.0  # seconds a sample of a pixel, of one slot, over the latest batches
        self._tile_cost: dict[int, float] = {}
        self._clock = time.monotonic()
        self._rated = (self._clock, self.plan.samples)

    @property
    def done(self) -> bool:
        """Whether the job has all that was asked for."""
        if self.plan.done:
            return True
        return self.seconds is not None and self.active_s >= self.seconds and self.plan.has_first_wave

    @property
    def progress(self) -> float:
        """0 ... 1, by samples or by time, whichever is further."""
        by_samples = self.plan.samples / max(self.plan.target_samples, 1)
        by_time = self.active_s / self.seconds if self.seconds else 0.0
        return 1.0 if self.done else min(max(by_samples, by_time), 0.9999)

    @property
    def eta_s(self) -> float | None:
        """Seconds that are left, or None where that is not known yet."""
        by_time = max(0.0, self.seconds - self.active_s) if self.seconds is not None else None
        if self.samples_per_s <= 0.0:
            return by_time
        by_samples = (self.plan.target_samples - self.plan.samples) / self.samples_per_s
        return by_samples if by_time is None else min(by_time, by_samples)

    def next(self, batch_seconds: float, slots: int) -> Range | None:
        """The next batch for one of `slots` slots, to take about `batch_seconds`; less where the end is near.

        Near the end a batch is at most a third of what is left for each slot, so that all slots end at about the same time.
        """
        cost = self._pixel_cost
        left_s = (self.plan.target_samples - self.plan.samples) * cost / max(slots, 1)
        aim = min(batch_seconds, max(SMALLEST_BATCH_S, left_s / 3))

        def samples_wanted(tile: int) -> int:
            rect = self.film.tiles[tile]
            a_sample = self._tile_cost.get(tile, cost) * rect.w * rect.h
            return int(aim / a_sample) if a_sample > 0.0 else 1

        return self.plan.next(samples_wanted)

    def expected_s(self, batch: Range) -> float:
        """How long a batch is expected to take on one slot; 0 where nothing is known."""
        rect = self.film.tiles[batch.tile]
        return self._tile_cost.get(batch.tile, self._pixel_cost) * rect.w * rect.h * batch.count

    def came_back(self, batch: Range, seconds: float) -> None:
        """The film has a batch, or dropped it; `settle` tells the plan."""
        self.handed_back = None
        self._learn(batch, seconds)
        self._unsettled.append(batch)

    def settle(self) -> None:
        """Let the plan look at the film for what came back. Raises FilmWaits or FilmLost; then it is to be called again."""
        while self._unsettled:
            self.plan.settle(self._unsettled[0])
            self._unsettled.pop(0)

    def asks_for(self, spp: int, noise: float | None, seconds: float | None) -> bool:
        """Whether this is other than what the job is rendered for now."""
        return (spp, noise, seconds) != (self.plan.spp, self.plan.noise, self.seconds)

    def ask(self, spp: int, noise: float | None, seconds: float | None) -> None:
        """Take over what is asked for now. What is out counts as lost. Raises FilmWaits or FilmLost."""
        self.plan = self._plan(spp, noise)
        self.seconds = seconds
        self._unsettled.clear()

    def tick(self, rendering: bool) -> None:
        """Let the wall clock run, where the job is being rendered, and renew its speed about once a second."""
        now = time.monotonic()
        if rendering:
            self.active_s += now - self._clock
        self._clock = now
        since, samples = self._rated
        if now - since >= 1.0:
            rate = (self.plan.samples - samples) / (now - since)
            self.samples_per_s += (rate - self.samples_per_s) * (SMOOTHING if self.samples_per_s else 1.0)
            self._rated = (now, self.plan.samples)

    def _learn(self, batch: Range, seconds: float) -> None:
        rect = self.film.tiles[batch.tile]
        cost = seconds / (rect.w * rect.h * batch.count)
        if cost > 0.0:
            self._tile_cost[batch.tile] = cost
            self._pixel_cost += (cost - self._pixel_cost) * (SMOOTHING if self._pixel_cost else 1.0)

    def _plan(self, spp: int, noise: float | None) -> FramePlan:
        return FramePlan(self.film.tiles, spp, noise, self._coverage, self._tile_noise)

    def _coverage(self, tile: int) -> Coverage:
        return self.film.coverage(self.frame, tile)

    def _tile_noise(self, tile: int) -> float:
        sums = self.film.tile_sums(self.frame, tile)
        return float("inf") if sums is None else film_math.noise(sums, self.settings.film_exponent)
