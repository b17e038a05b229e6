"""Trust, but verify: a share of the batches is rendered a second time by another worker, and compared to the bit.

The second is handed out as any other batch, through the same queue, so that no worker knows which of its answers is looked at.
If the first takes it again, it is handed out once more. Where two workers differ, further answers decide: what two different
workers agree on is right. Whoever has said otherwise is set aside, and all that it has sent is taken out of the films of jobs
that are not over, and rendered again; those that are over are marked (service/maintenance/taint.py). While nobody can decide, the
job goes on but does not end.
"""

from __future__ import annotations

import logging
import random
import time
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field

import redis

from service.events import Events, WorkerSetAside
from service.scheduling.dispatching.batch_groups import work_of
from service.scheduling.dispatching.dispatch import Dispatcher, QueueError
from service.scheduling.dispatching.leases import Lease
from service.scheduling.dispatching.scheduler import Scheduler
from service.scheduling.fleet.workers import BY_A_PERSON, Workers
from service.scheduling.incoming.merging import batch_of
from service.scheduling.incoming.messages import BatchDone
from service.scheduling.jobs.active_job import ActiveJob
from service.scheduling.jobs.plan import Range
from service.scheduling.trust.votes import Votes

__all__ = ["Trust"]

MOST_OPEN = 64  # batches that are looked at at a time: each is kept in memory until then
MOST_ASKED = 24  # answers to one of them that agree and are all of one worker's; then it is let be
SAID = "Set aside: it rendered something else than other workers"

log = logging.getLogger(__name__)

Answer = tuple[BatchDone, bytes]


@dataclass
class _Check:
    """A batch that is looked at."""

    job: str
    kind: str
    batch: Range
    votes: Votes
    patience_s: float
    asked: set[str] = field(default_factory=set)  # leases under which it was handed out again
    waits_since: float | None = None  # since it was; None: it is not out


class Trust:
    """Lives in the engine's thread."""

    def __init__(self, scheduler: Scheduler, workers: Workers, dispatcher: Dispatcher, deadline_s: float, events: Events) -> None:
        self._scheduler = scheduler
        self._workers = workers
        self._dispatcher = dispatcher
        self._deadline_s = deadline_s
        self._open: list[_Check] = []
        self._wrong: dict[str, tuple[str, str]] = {}  # workers that were found out, and not dealt with yet: a job, and why
        self._chance = random.Random()
        self._events = events
        self.counts: Counter[str] = Counter()  # batches verified, differed; workers distrusted

    def begin(self) -> None:
        """Know again whom an earlier life of the service has set aside. Raises redis.RedisError."""
        self._scheduler.distrusted |= {name for name, why in self._workers.all_orders().items() if why.startswith(SAID)}
        for worker in sorted(self._scheduler.distrusted):
            self._events.publish(WorkerSetAside(worker, None))

    def sort_out(self, job: ActiveJob, answers: list[Answer]) -> list[Answer]:
        """Of what came back for a job, what is to go into its film: neither what was only to be compared, nor what comes from a
        worker that is not believed; nor, where batches are looked at, what is nobody's or of several, which nobody could take
        back."""
        kept = []
        for message, sums in answers:
            check = next((each for each in self._open if message.batch in each.asked), None)
            nobody_s = bool(job.verify) and (len(message.senders) != 1 or not all(message.senders))
            if nobody_s or not self._scheduler.distrusted.isdisjoint(message.senders):
                for piece in message.pieces:
                    self._scheduler.came_back(job, piece.batch, None, 0.0, piece.worker or message.worker)
            elif check is not None:
                self._answered(job, check, message, sums)
            else:
                kept.append((message, sums))
        return kept

    def taken(self, job: ActiveJob, message: BatchDone, batch: Range, sums: bytes) -> None:
        """The film took a batch: it may be one that is looked at."""
        if (
            not job.verify
            or len(message.senders) != 1
            or self._chance.random() >= job.verify
            or len(self._open) >= MOST_OPEN
            or job.kind is None
        ):
            return
        (sender,) = message.senders
        if not self._ready(job.kind) - {sender} or not sender:
            return
        patience = max(self._deadline_s, 10 * job.expected_s(batch))
        check = _Check(job.id, job.kind, batch, Votes(job.film.tiles[batch.tile]), patience)
        check.votes.add(sender, sums)
        self._open.append(check)
        self._count()
        with suppress(QueueError):  # the next review asks
            self._ask(job, check)

    def review(self) -> None:
        """Hand out what is to be rendered again, and let be what cannot be. Raises QueueError."""
        for check in list(self._open):
            job = self._scheduler.jobs.get(check.job)
            ready = self._ready(check.kind)
            if job is None:
                self._close(check)
                continue
            if check.waits_since is not None and time.monotonic() - check.waits_since > check.patience_s:
                check.waits_since, check.patience_s = None, 2 * check.patience_s
            if check.waits_since is not None:
                continue
            if not check.votes.differ and (
                not check.votes.workers or not ready - check.votes.workers or len(check.votes.cast) >= MOST_ASKED
            ):
                self._close(check)
            elif check.votes.may_help(ready):
                self._ask(job, check)
            else:
                self._decide_by_hand(check)

    def carry_out(self, again: Callable[[ActiveJob], None]) -> None:
        """Set aside whom the latest answers have found out. again(job): it is taken up anew, without what they have sent."""
        for worker, (found_in, why) in list(self._wrong.items()):
            self._scheduler.distrusted.add(worker)
            for check in self._open:
                check.votes.take_back(worker)
            self._open = [check for check in self._open if check.votes.cast]
            partly: list[str] = []
            for job in list(self._scheduler.jobs.values()):
                if job.film.has_sent(worker):
                    partly.append(job.id)
                    job.history.happened("distrusted", worker)
                    again(job)
            self.counts["distrusted"] += 1
            log.warning("%s is set aside: %s; jobs that are rendered again in part: %s", worker, why, partly)
            self._pause(worker, why)
            details = {"worker": worker, "job": found_in, "why": f"{why}.", "rendered_again": partly}
            self._events.publish(WorkerSetAside(worker, details))
            del self._wrong[worker]
        self._count()

    def sentences(self) -> Mapping[str, str]:
        """Of jobs that wait for a decision: what is asked of people."""
        return {
            check.job: (
                f"{' and '.join(sorted(check.votes.workers))} rendered the same batch differently, and no other worker is there "
                "to decide. Start a third of the same kind, or pause the one that you do not trust."
            )
            for check in self._open
            if check.votes.differ and check.waits_since is None
        }

    def _answered(self, job: ActiveJob, check: _Check, message: BatchDone, sums: bytes) -> None:
        batch = batch_of(message, job)
        check.asked.discard(message.batch)
        check.waits_since = None
        if batch != check.batch or check not in self._open:
            return
        did_differ = check.votes.differ
        with suppress(ValueError):  # no sums at all: somebody else is asked
            check.votes.add(message.worker, sums)
        if check.votes.differ and not did_differ:
            self.counts["differed"] += 1
            where = f"samples {batch.first} to {batch.first + batch.count - 1} of tile {batch.tile}"
            log.warning("job %s: %s rendered %s differently", job.id, " and ".join(sorted(check.votes.workers)), where)
            job.history.log.say(f"{' and '.join(sorted(check.votes.workers))} rendered {where} differently")
        if check.votes.right is None:
            with suppress(QueueError):  # the next review asks
                if check.votes.may_help(self._ready(check.kind)) and len(check.votes.cast) < MOST_ASKED:
                    self._ask(job, check)
            return
        self.counts["verified"] += 1
        right = sorted(check.votes.workers - check.votes.wrong)
        for worker in check.votes.wrong:
            self._find_out(worker, check, f"as {' and '.join(right)} rendered them")
        self._close(check)

    def _decide_by_hand(self, check: _Check) -> None:
        """Whom a person has paused of those who differ is the one that is wrong."""
        orders = self._workers.roster.orders
        paused = {worker for worker in check.votes.workers if orders.get(worker) == BY_A_PERSON}
        if paused and paused != check.votes.workers:
            for worker in paused:
                self._find_out(worker, check, "as somebody decided by pausing it")
            self._close(check)

    def _find_out(self, worker: str, check: _Check, how: str) -> None:
        batch = check.batch
        where = f"samples {batch.first} to {batch.first + batch.count - 1} of tile {batch.tile} of job {check.job}"
        self._wrong[worker] = check.job, f"{SAID} ({where}), {how}"

    def _pause(self, worker: str, why: str) -> None:
        sentence = f"{why}. All that it has sent of unfinished jobs is rendered again. Test its memory, then let it go on."
        with suppress(redis.RedisError):  # its answers are refused meanwhile
            self._workers.pause(worker, sentence)
            self._workers.look(now=True)

    def _ask(self, job: ActiveJob, check: _Check) -> None:
        """Hand it out once more. Raises QueueError."""
        frame = job.frames.get(check.batch.frame)
        if frame is None or check.kind not in frame.compiled:  # of a shot, what the frame was compiled to is gone
            self._close(check)
            return
        lease = Lease(job.id, check.kind, check.batch, check.patience_s)  # of our own: the plan has this batch already
        lease.queue = job.queue(check.kind)
        check.asked.add(lease.id)
        check.waits_since = time.monotonic()
        self._dispatcher.send_batch(work_of(job, lease, check.batch), lease.queue)

    def _ready(self, kind: str) -> set[str]:
        ready = {report.name for report in self._workers.roster.ready() if report.kind == kind}
        return ready - self._scheduler.distrusted

    def _close(self, check: _Check) -> None:
        self._open = [each for each in self._open if each is not check]
        self._count()

    def _count(self) -> None:
        """Tell jobs how many decisions they wait for; while somebody is found out, all wait."""
        self._scheduler.checks.clear()
        self._scheduler.checks.update(check.job for check in self._open)
        if self._wrong:
            self._scheduler.checks.update(list(self._scheduler.jobs))
