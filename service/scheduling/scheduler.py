"""Hands out batches: a short window ahead of the workers, by priority and in fair shares, and again where they do not come
back."""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Callable
from heapq import heapify, heappop, heappush
from itertools import count, groupby
from typing import Any

import redis

from renderer.settings import Tile
from service.scheduling.active_job import FAILURES_ALLOWED, LOSSES_ALLOWED, ActiveJob, Trouble
from service.scheduling.dispatch import Dispatcher
from service.scheduling.leases import Lease, Leases
from service.scheduling.plan import Range
from service.scheduling.suspicion import Suspicion
from service.scheduling.workers import Workers
from service.settings import Settings
from worker.contract import RenderBatch, render_queue

__all__ = ["Scheduler"]

UNSEEN_ALLOWED = 3  # looks, one a second
STRAGGLER_S = 3.0
PATIENCE_WITH_FEW_S = 5.0

log = logging.getLogger(__name__)


class Scheduler:
    """Decides what is rendered next. Lives in the engine's thread."""

    def __init__(
        self, settings: Settings, dispatcher: Dispatcher, workers: Workers, on_start: Callable[[ActiveJob, str], bool]
    ) -> None:
        """on_start(job, kind): records that a job begins on workers of a kind; False where it is not ready to."""
        self._settings = settings
        self._dispatcher = dispatcher
        self._workers = workers
        self._on_start = on_start
        self.leases = Leases()
        self.jobs: dict[str, ActiveJob] = {}
        self.suspicion = Suspicion()
        self._turn = count(1)
        self.lost = 0  # batches that were handed out again

    def fill(self) -> None:
        """Hand out batches until every kind's window is full. Raises QueueError."""
        for kind in sorted({report.kind for report in self._workers.ready()}):
            slots = self._workers.slots(kind)
            room = slots * self._settings.window_per_slot - self.leases.batches(kind)
            for _, equals in groupby(self._in_turn(kind), lambda job: job.priority):
                room -= self._share(list(equals), kind, slots, room)
                if room <= 0:
                    break

    def _share(self, jobs: list[ActiveJob], kind: str, slots: int, room: int) -> int:
        """Hand out up to `room` batches of jobs of one priority; returns how many.

        Always of the job that has the fewest in hand, and of these of the one that has waited longest: batches take about the
        same time, so the jobs get about the same share of the workers.
        """
        in_hand = Counter(lease.owner for lease in self.leases)
        queue = [(in_hand[job.id], job.served, i, job) for i, job in enumerate(jobs)]
        heapify(queue)
        handed_out = 0
        while queue and handed_out < room:
            held, _, i, job = heappop(queue)
            if not self._on_start(job, kind):
                continue
            batch = job.next(self._settings.batch_seconds, slots)
            if batch is None:
                continue
            self._hand_out(job, batch, kind)
            handed_out += 1
            job.served = next(self._turn)
            heappush(queue, (held + 1, job.served, i, job))
        return handed_out

    def came_back(self, job: ActiveJob, lease: str, batch: Range, seconds: float, worker: str) -> None:
        """A batch's sums were taken by the film, or dropped by it as known."""
        self.leases.end(lease)
        trouble = job.trouble.pop(batch, None)
        failed_on = trouble.workers if trouble else []
        self.suspicion.succeeded(worker, failed_on)
        for other in set(failed_on):
            self._set_aside_if_alone(other)
        job.learn(batch, seconds)
        job.plan.settle(batch)

    def failed(self, job: ActiveJob, lease: str, batch: Range, worker: str, error: str, reproduce: str | None) -> Trouble | None:
        """A worker could not render a batch. It is handed out again, or what stops the job is returned."""
        if self.leases.end(lease) is None:
            return None  # handed out again meanwhile, or of an earlier life of the service
        trouble = job.trouble.setdefault(batch, Trouble())
        trouble.workers.append(worker)
        trouble.error, trouble.reproduce = error, reproduce
        able = {report.name for report in self._workers.ready() if report.kind == job.kind}
        enough_workers = len(able & set(trouble.workers)) >= max(min(FAILURES_ALLOWED, len(able)), 1)
        # A worker that fails at once may have it again and again before another gets it.
        is_hopeless = enough_workers or time.monotonic() - trouble.since > PATIENCE_WITH_FEW_S
        if len(trouble.workers) >= FAILURES_ALLOWED and is_hopeless:
            return trouble
        job.plan.lose(batch)
        self.suspicion.failed(worker, (job.id, batch))
        self._set_aside_if_alone(worker)
        return None

    def returned(self, job: ActiveJob, lease: str, batch: Range, worker: str, why: str) -> None:
        """A worker could not render a batch by its own trouble: it is handed out again, and the job is not to blame."""
        if self.leases.end(lease) is None:
            return
        log.info("job %s: %s", job.id, why)
        job.plan.lose(batch)
        self.suspicion.failed(worker, (job.id, batch))
        self._set_aside_if_alone(worker)

    def withdraw(self, job: ActiveJob) -> None:
        """Take back what waits of a job; what a worker has in hand comes back by itself, and is lost for the plan."""
        mine = self.leases.of(job.id)
        for kind in {lease.kind for lease in mine}:
            try:
                self._dispatcher.take_back(render_queue(kind), {lease.id for lease in mine})
            except redis.RedisError as error:
                log.warning("batches of job %s stay in the queue: %s", job.id, error)
        for lease in mine:
            self.leases.end(lease.id)
            if lease.batch is not None:
                job.plan.lose(lease.batch)

    def review(self) -> list[tuple[ActiveJob, str]]:
        """Once a second: find batches that are overdue or lost, and hand them out again.

        Returns the jobs that must stop, each with a sentence. Raises redis.RedisError.
        """
        waiting = {id for kind in self._kinds() for id in self._dispatcher.waiting(render_queue(kind))}
        in_hand: dict[tuple[Any, ...], str] = {}
        for report in self._workers.reports.values():
            for doing in report.current:
                if "job" in doing:
                    in_hand[doing["job"], tuple(doing["tile"]), doing["first"], doing["count"]] = report.name
        hopeless = []
        for lease in self.leases:
            job = self.jobs.get(lease.owner)
            if lease.batch is None or job is None:
                continue
            tile = tuple(job.film.tiles[lease.batch.tile])
            holder = in_hand.get((job.id, tile, lease.batch.first, lease.batch.count))
            lease.unseen = 0 if holder or lease.id in waiting else lease.unseen + 1
            holder_gone = lease.holder is not None and holder is None and lease.holder not in self._workers.reports
            lease.holder = holder or lease.holder
            lease.is_held = holder is not None
            if (holder_gone and lease.id not in waiting) or lease.unseen >= UNSEEN_ALLOWED or lease.is_overdue:
                if (stop := self._lost(job, lease, blame=holder_gone or lease.is_overdue)) is not None:
                    hopeless.append((job, stop))
            elif holder and self._is_straggler(job, lease):
                lease.doubled = True
                job.plan.lose(lease.batch)
        return hopeless

    def _set_aside_if_alone(self, worker: str) -> None:
        """Pause a worker whose batches fail while others render theirs, unless nobody else is left. Raises redis.RedisError."""
        kinds = {report.name: report.kind for report in self._workers.ready()}
        others = [name for name, kind in kinds.items() if kind == kinds.get(worker) and name != worker]
        failures = self.suspicion.of(worker, others)
        if worker in kinds and others and failures >= FAILURES_ALLOWED:
            log.warning("%s is set aside after %d failures", worker, failures)
            why = (
                f"Set aside: {failures} of its batches failed while others rendered theirs. Look into its log, then let it go on."
            )
            self._workers.pause(worker, why)

    def _lost(self, job: ActiveJob, lease: Lease, blame: bool) -> str | None:
        assert lease.batch is not None
        self.leases.end(lease.id)
        self.lost += 1
        trouble = job.trouble.setdefault(lease.batch, Trouble())
        trouble.losses += blame
        log.info("job %s: a batch did not come back (%s, %s) and is handed out again", job.id, lease.holder, lease.batch)
        if trouble.losses >= LOSSES_ALLOWED:
            tile, first, count = lease.batch
            return (
                f"The samples {first} to {first + count - 1} of the tile at {job.film.tiles[tile][:2]} did not come back "
                f"{trouble.losses} times. Look into the workers' logs; setting the job to running tries again."
            )
        job.plan.lose(lease.batch)
        return None

    def _is_straggler(self, job: ActiveJob, lease: Lease) -> bool:
        """Whether others stand idle while they wait for this batch alone: then a second worker may try it as well."""
        late = time.monotonic() - lease.issued > max(STRAGGLER_S, 6 * lease.expected_s)
        idle = self._workers.slots(lease.kind) > self.leases.batches(lease.kind)
        return late and idle and not lease.doubled

    def ahead_of(self, job: ActiveJob) -> int:
        """How many jobs of a higher priority are rendered before this one."""
        kind = job.kind or self._workers.best_kind()
        order = self._in_turn(kind) if kind is not None else []
        return sum(1 for other in order if other.priority > job.priority) if job in order else 0

    def _kinds(self) -> set[str]:
        return {lease.kind for lease in self.leases}

    def _in_turn(self, kind: str) -> list[ActiveJob]:
        """The jobs that workers of a kind may render: higher priority first, then older first."""
        jobs = [job for job in list(self.jobs.values()) if job.state in ("queued", "running") and not job.done]
        jobs = [job for job in jobs if job.kind == kind or (job.kind is None and kind == self._workers.best_kind())]
        jobs.sort(key=lambda job: (-job.priority, job.created, job.id))
        return jobs

    def _hand_out(self, job: ActiveJob, batch: Range, kind: str) -> None:
        expected = job.expected_s(batch)
        trouble = job.trouble.get(batch)
        patience = max(self._settings.batch_deadline, 10 * expected) * 2 ** (trouble.losses if trouble else 0)
        lease = Lease(job.id, kind, batch, patience, expected)
        tile: Tile = job.film.tiles[batch.tile]
        work = RenderBatch(lease.id, job.id, job.frame, job.compiled[kind], tile, batch.first, batch.count, job.settings)
        try:
            self._dispatcher.send_batch(work, kind)
        except BaseException:
            job.plan.lose(batch)
            raise
        self.leases.add(lease)
