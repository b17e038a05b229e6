"""Verification: a fraction of the batches is rendered again by another worker, and the results are compared bit by bit.

The repetition is sent like any other batch, through the same queue, so a worker cannot detect which of its results are
verified. If the first worker happens to fetch it, it is sent once more. If two results differ, further repetitions decide: a
result is correct if two different workers return it. A worker with another result is paused; its samples are removed from the
films of unfinished jobs and rendered again, and finished jobs are marked (service/maintenance/taint.py). Until the decision,
the job continues but cannot finish.
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

from renderer.sentences import Sentence
from service.errors import QueueError
from service.events import Events, WorkerQuarantined
from service.scheduling.dispatching.batch_groups import batch_message
from service.scheduling.dispatching.dispatcher import Dispatcher
from service.scheduling.dispatching.leases import Lease
from service.scheduling.dispatching.scheduler import Scheduler
from service.scheduling.fleet.workers import PAUSED_BY_USER, Workers
from service.scheduling.incoming.merging import batch_of
from service.scheduling.incoming.messages import BatchDone
from service.scheduling.jobs.active_job import ActiveJob
from service.scheduling.jobs.plan import Range
from service.scheduling.trust.votes import Votes, voters_among

__all__ = ["Trust"]

MAX_OPEN = 64  # batches verified at once; their results are held in memory
MAX_EQUAL_RESULTS = 24  # equal results of one worker alone after which a verification is dropped
REASON_OF_OLD_RELEASES = "Excluded: its results differed from those of other workers"  # of releases without codes

log = logging.getLogger(__name__)

Answer = tuple[BatchDone, bytes]


@dataclass
class _Verification:
    """A batch under verification, with the results received so far."""

    job: str
    kind: str
    batch: Range
    votes: Votes
    patience_s: float
    asked: set[str] = field(default_factory=set)  # leases of its repetitions
    waits_since: float | None = None  # time at which the current repetition was sent; None: none is outstanding


class Trust:
    """Verifies batches, and pauses workers with wrong results. Used only by the engine's thread."""

    def __init__(self, scheduler: Scheduler, workers: Workers, dispatcher: Dispatcher, deadline_s: float, events: Events) -> None:
        self._scheduler = scheduler
        self._workers = workers
        self._dispatcher = dispatcher
        self._deadline_s = deadline_s
        self._open: list[_Verification] = []
        self._wrong: dict[str, tuple[str, str]] = {}  # workers found wrong and not handled yet: job, reason
        self._chance = random.Random()
        self._events = events
        self.counts: Counter[str] = Counter()  # batches verified, differed; workers distrusted

    def begin(self) -> None:
        """Restores the set of distrusted workers of a previous run. Raises redis.RedisError."""
        self._scheduler.distrusted |= {name for name, reason in self._workers.pause_reasons().items() if _is_distrust(reason)}
        for worker in sorted(self._scheduler.distrusted):
            self._events.publish(WorkerQuarantined(worker, None))

    def mergeable_answers(self, job: ActiveJob, answers: list[Answer]) -> list[Answer]:
        """Returns the results that may be merged into the job's film. answers: messages with their packed sums.

        Excludes repetitions for verification and results of distrusted workers. If the job is verified, also excludes results
        without exactly one sender, which could not be removed later.
        """
        kept = []
        for message, sums in answers:
            verification = next((each for each in self._open if message.batch in each.asked), None)
            has_unknown_sender = bool(job.verify) and (len(message.senders) != 1 or not all(message.senders))
            if has_unknown_sender or not self._scheduler.distrusted.isdisjoint(message.senders):
                for piece in message.pieces:
                    self._scheduler.outcomes.end_batch(job, piece.batch, None, 0.0, piece.worker or message.worker)
            elif verification is not None:
                self._handle_answer(job, verification, message, sums)
            else:
                kept.append((message, sums))
        return kept

    def consider_verification(self, job: ActiveJob, message: BatchDone, batch: Range, sums: bytes) -> None:
        """Selects at random whether to verify a batch that the film has accepted. If so, sends a repetition."""
        if (
            not job.verify
            or len(message.senders) != 1
            or self._chance.random() >= job.verify
            or len(self._open) >= MAX_OPEN
            or job.kind is None
        ):
            return
        (sender,) = message.senders
        if not voters_among(self._trusted_ready_workers(job.kind)) - voters_among({sender}) or not sender:
            return
        patience = max(self._deadline_s, 10 * job.expected_s(batch))
        verification = _Verification(job.id, job.kind, batch, Votes(job.film.tiles[batch.tile]), patience)
        verification.votes.add(sender, sums)
        self._open.append(verification)
        self._update_counts()
        with suppress(QueueError):  # sent at the next review
            self._send_repetition(job, verification)

    def advance_checks(self) -> None:
        """Sends due repetitions, and drops verifications that cannot be completed. Called once a second. Raises QueueError."""
        for verification in list(self._open):
            job = self._scheduler.jobs.get(verification.job)
            ready = self._trusted_ready_workers(verification.kind)
            if job is None:
                self._end_verification(verification)
                continue
            if verification.waits_since is not None and time.monotonic() - verification.waits_since > verification.patience_s:
                verification.waits_since, verification.patience_s = None, 2 * verification.patience_s
            if verification.waits_since is not None:
                continue
            if not verification.votes.has_differences and (
                not verification.votes.workers
                or not voters_among(ready) - verification.votes.voters
                or len(verification.votes.cast) >= MAX_EQUAL_RESULTS
            ):
                self._end_verification(verification)
            elif verification.votes.could_decide(ready):
                self._send_repetition(job, verification)
            else:
                self._apply_user_decision(verification)

    def apply_distrust(self, reload: Callable[[ActiveJob], None]) -> None:
        """Marks workers whose results were wrong as distrusted, and pauses them. reload: reloads a job without their samples."""
        for worker, (found_in, reason) in list(self._wrong.items()):
            self._scheduler.distrusted.add(worker)
            for verification in self._open:
                verification.votes.remove_worker(worker)
            self._open = [verification for verification in self._open if verification.votes.cast]
            partly: list[str] = []
            for job in list(self._scheduler.jobs.values()):
                if job.film.has_sums_of(worker):
                    partly.append(job.id)
                    job.history.add_event("distrusted", worker)
                    reload(job)
            self.counts["distrusted"] += 1
            log.warning("worker %s is quarantined: %s; jobs that are partly rendered again: %s", worker, reason, partly)
            self._quarantine(worker, reason)
            details = {"worker": worker, "job": found_in, "why": f"{reason}.", "rendered_again": partly}
            self._events.publish(WorkerQuarantined(worker, details))
            del self._wrong[worker]
        self._update_counts()

    def required_actions(self) -> Mapping[str, str]:
        """Returns, by id of each job whose verification no other worker can decide, a sentence that tells a user what to do."""
        return {
            verification.job: (
                Sentence(
                    "worker-results-disputed",
                    "{workers} rendered the same batch differently, and no other worker can decide. Start a "
                    "third of the same kind, or pause the one that you do not trust.",
                    workers=" and ".join(sorted(verification.votes.workers)),
                )
            )
            for verification in self._open
            if verification.votes.has_differences and verification.waits_since is None
        }

    def _handle_answer(self, job: ActiveJob, verification: _Verification, message: BatchDone, sums: bytes) -> None:
        batch = batch_of(message, job)
        verification.asked.discard(message.batch)
        verification.waits_since = None
        if batch != verification.batch or verification not in self._open:
            return
        did_differ = verification.votes.has_differences
        with suppress(ValueError):  # invalid sums: another repetition is sent
            verification.votes.add(message.worker, sums)
        if verification.votes.has_differences and not did_differ:
            self.counts["differed"] += 1
            where = f"samples {batch.first} to {batch.first + batch.count - 1} of tile {batch.tile}"
            log.warning("job %s: %s rendered %s differently", job.id, " and ".join(sorted(verification.votes.workers)), where)
            job.history.log.add_line(f"{' and '.join(sorted(verification.votes.workers))} rendered {where} differently")
        if verification.votes.agreed_index is None:
            with suppress(QueueError):  # sent at the next review
                if (
                    verification.votes.could_decide(self._trusted_ready_workers(verification.kind))
                    and len(verification.votes.cast) < MAX_EQUAL_RESULTS
                ):
                    self._send_repetition(job, verification)
            return
        self.counts["verified"] += 1
        right = sorted(verification.votes.workers - verification.votes.outvoted_workers)
        for worker in verification.votes.outvoted_workers:
            self._mark_wrong(
                worker,
                verification,
                Sentence("worker-outvoted", "since {workers} agree on another result", workers=" and ".join(right)),
            )
        self._end_verification(verification)

    def _apply_user_decision(self, verification: _Verification) -> None:
        """Ends a verification without a decision if a user has paused some of the workers whose results differ.

        The results of these workers are treated as wrong.
        """
        orders = self._workers.roster.orders
        paused = {worker for worker in verification.votes.workers if orders.get(worker) == PAUSED_BY_USER}
        if paused and paused != verification.votes.workers:
            for worker in paused:
                self._mark_wrong(worker, verification, Sentence("worker-distrusted-by-user", "since it was paused by a user"))
            self._end_verification(verification)

    def _mark_wrong(self, worker: str, verification: _Verification, evidence: str) -> None:
        batch = verification.batch
        where = Sentence(
            "samples-of-tile",
            "samples {first} to {last} of tile {tile} of job {job}",
            first=batch.first,
            last=batch.first + batch.count - 1,
            tile=batch.tile,
            job=verification.job,
        )
        reason = Sentence(
            "worker-results-differ",
            "Quarantined: its results differ from those of other workers ({samples}), {verdict}",
            samples=where,
            verdict=evidence,
        )
        self._wrong[worker] = verification.job, reason

    def _quarantine(self, worker: str, reason: str) -> None:
        sentence = Sentence(
            "worker-quarantined",
            "{reason}. All its results of unfinished jobs are rendered again. Test its memory, then resume it.",
            reason=reason,
        )
        with suppress(redis.RedisError):  # its results are rejected meanwhile
            self._workers.pause(worker, sentence)
            self._workers.refresh(now=True)

    def _send_repetition(self, job: ActiveJob, verification: _Verification) -> None:
        """Sends a batch that is being verified to be rendered once more. Raises QueueError."""
        frame = job.frames.get(verification.batch.frame)
        if frame is None or verification.kind not in frame.compiled:  # the compiled frame of the shot was released
            self._end_verification(verification)
            return
        # a separate lease, since the plan has this batch already
        lease = Lease(job.id, verification.kind, verification.batch, verification.patience_s)
        lease.queue = job.queue_name(verification.kind)
        verification.asked.add(lease.id)
        verification.waits_since = time.monotonic()
        self._dispatcher.send_batch(batch_message(job, lease, verification.batch), lease.queue)

    def _trusted_ready_workers(self, kind: str) -> set[str]:
        ready = {report.name for report in self._workers.roster.ready_reports() if report.kind == kind}
        return ready - self._scheduler.distrusted

    def _end_verification(self, verification: _Verification) -> None:
        self._open = [each for each in self._open if each is not verification]
        self._update_counts()

    def _update_counts(self) -> None:
        """Updates the jobs that cannot finish: those with an open verification.

        While the samples of a worker with wrong results are not removed yet, no job can finish.
        """
        self._scheduler.checks.clear()
        self._scheduler.checks.update(verification.job for verification in self._open)
        if self._wrong:
            self._scheduler.checks.update(list(self._scheduler.jobs))


def _is_distrust(reason: str) -> bool:
    """Returns True if a worker was paused because its results were wrong. reason: stored reason of the pause."""
    return reason.startswith(REASON_OF_OLD_RELEASES) or (isinstance(reason, Sentence) and reason.code == "worker-quarantined")
