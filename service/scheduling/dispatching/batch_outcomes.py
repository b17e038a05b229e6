"""Outcomes of outstanding batches: rendered, failed, returned, recalled, withdrawn, late or lost."""

from __future__ import annotations

import logging
import time
from contextlib import suppress
from functools import cache

import redis

from renderer.frames import frame_number, frame_text
from renderer.sentences import Sentence, joined_sentences
from service.scheduling.dispatching.dispatcher import Dispatcher
from service.scheduling.dispatching.leases import Lease, Leases
from service.scheduling.dispatching.lost_batches import LossVerdict, LostLeaseFinder
from service.scheduling.dispatching.pacing import BatchSizing
from service.scheduling.dispatching.sites import Sites
from service.scheduling.faults.bulkhead import Bulkheads, Step
from service.scheduling.faults.suspicion import Suspicion
from service.scheduling.fleet.workers import Workers
from service.scheduling.incoming.results import Results
from service.scheduling.jobs.active_job import ActiveJob
from service.scheduling.jobs.batch_failures import FAILURES_ALLOWED, LOSSES_ALLOWED, BatchFailures
from service.scheduling.jobs.plan import Range
from service.scheduling.jobs.reproduce import reproduce
from service.scheduling.jobs.shares import Shares
from telemetry.log_lines import ids

__all__ = ["BatchOutcomes", "batch_description"]

FEW_SLOTS_TIMEOUT_S = 5.0
CLOCK_TOLERANCE_S = 60.0  # seconds of tolerance for a worker's clock
RETURNED_PAUSE_S = 1.0  # seconds before the only worker gets a returned batch again

log = logging.getLogger(__name__)


class BatchOutcomes:
    """Ends the leases of batches, and returns batches that were not rendered to their plans. Used only by the engine's thread.

    Batches that fail or are lost too often end their job or frame. Workers whose batches fail while others render theirs are
    quarantined.
    """

    def __init__(
        self,
        jobs: dict[str, ActiveJob],
        leases: Leases,
        shares: Shares,
        sites: Sites,
        dispatcher: Dispatcher,
        workers: Workers,
        bulkheads: Bulkheads,
        pace: BatchSizing,
    ) -> None:
        """Stores the parameters. jobs, leases, shares: shared with the scheduler, which changes them."""
        self._jobs = jobs
        self._leases = leases
        self._shares = shares
        self._sites = sites
        self._dispatcher = dispatcher
        self._workers = workers
        self._bulkheads = bulkheads
        self._pace = pace
        self._missing = LostLeaseFinder(leases, workers, dispatcher)
        self.suspicion = Suspicion()
        self.lost = 0  # batches that were handed out again
        self.doubled = 0  # duplicates of straggling batches

    def mark_answered(self, owner: str, lease: str) -> None:
        """Marks the lease of a batch whose sums were read. owner: job id. lease: lease id.

        The sums are stored once the film accepts them. Until then the lease cannot become lost.
        """
        known = self._leases.get(lease)
        if known is not None and known.owner == owner:
            self._leases.mark_answered(known)

    def end_batch(self, job: ActiveJob, lease: str, batch: Range | None, seconds: float, worker: str) -> None:
        """Ends the lease of a batch that the film accepted or dropped as a duplicate. lease: its id.

        batch: None if the job does not need the batch any more. seconds: reported rendering time.
        """
        ended = self._end_lease(job, lease)
        if ended is not None:  # limits the reported time to the age of the lease
            seconds = min(seconds, time.monotonic() - ended.issued + CLOCK_TOLERANCE_S)
            if not ended.waits_in_message:
                self._pace.record_transit(ended.transit_s(seconds, time.monotonic()))
        if ended is not None and ended.batch is not None and ended.batch != batch:
            job.requeue(ended.batch)
        if ended is not None and batch is not None:
            self._shares.correct_charge(ended.kind, job.share, seconds - ended.charged_s)
        if batch is None:
            return
        job.history.rendered_by(worker)
        tile = job.film.tiles[batch.tile]
        job.history.log.count_returned(worker, batch.count * tile.w * tile.h, seconds)
        trouble = job.trouble.pop(batch, None)
        failed_on = trouble.workers if trouble else []
        self.suspicion.record_success(worker, failed_on)
        job.record_result(batch, seconds, self._card_worker(ended, worker))
        for other in set(failed_on):
            self._quarantine_if_others_succeed(other)

    def _card_worker(self, lease: Lease | None, worker: str) -> str:
        """Returns the name of the worker whose graphics card has rendered a batch; "" if a CPU has.

        lease: the batch's lease; None if it had already ended. worker: name of the worker that sent the result.
        """
        if lease is not None:
            return lease.only if lease.is_of_card else ""
        report = self._workers.roster.reports.get(worker)
        return worker if report is not None and report.has_card_queue else ""

    def handle_failure(
        self,
        job: ActiveJob,
        lease: str,
        batch: Range,
        worker: str,
        error: str,
        reproduce: str | None,
        trace: str = "",
        is_suspect: bool = True,
    ) -> BatchFailures | None:
        """Handles a batch that a worker failed to render: puts it back into the plan, to be dispatched again.

        Returns the failures of the batch if they end the job, else None. lease: its id. reproduce: command line that reproduces
        the error. trace: the last lines of the worker's error output. is_suspect: whether the failure counts against the
        worker.
        """
        ended = self._end_lease(job, lease)
        if ended is None:
            return None  # handed out again meanwhile, or from before a restart
        batch = ended.batch or batch  # the batch as handed out takes precedence over the message
        trouble = job.trouble.setdefault(batch, BatchFailures())
        trouble.workers.append(worker)
        trouble.error, trouble.reproduce = error, reproduce
        job.history.log.add_line(f"{worker} could not render {batch_description(batch)}: {error}", trace)
        able = {report.name for report in self._workers.roster.ready_reports() if report.kind == job.kind}
        enough_workers = len(able & set(trouble.workers)) >= max(min(FAILURES_ALLOWED, len(able)), 1)
        # A worker that fails at once may get the batch several times before another does.
        is_hopeless = enough_workers or time.monotonic() - trouble.since > FEW_SLOTS_TIMEOUT_S
        if len(trouble.workers) >= FAILURES_ALLOWED and is_hopeless:
            return trouble
        job.history.add_event("failed", f"{worker}: {error.splitlines()[0][:200] if error else 'a batch'}")
        job.requeue(batch)
        if is_suspect:
            self.suspicion.record_failure(worker, (job.id, batch))
            self._quarantine_if_others_succeed(worker)
        return None

    def handle_return(self, job: ActiveJob, lease: str, batch: Range, worker: str, reason: str) -> None:
        """Handles a batch that a worker sent back because of a fault of the worker: puts it back into the plan.

        This does not count against the job. lease: its id. reason: error sentence of the worker.
        """
        ended = self._end_lease(job, lease)
        if ended is None:
            return
        batch = ended.batch or batch
        if job.handed_back != reason:
            log.info("job %s: %s", job.id, reason, extra=ids(job=job.id, batch=lease, worker=worker))
            job.history.log.add_line(f"{batch_description(batch)} is handed out again: {reason}")
        job.handed_back = reason
        job.requeue(batch)
        self.suspicion.record_failure(worker, (job.id, batch))
        self._quarantine_if_others_succeed(worker)
        if not self._other_ready_workers(worker):
            job.rests_until = time.monotonic() + RETURNED_PAUSE_S

    def handle_recalled(self, job: ActiveJob, lease: str, batch: Range, worker: str, reason: str) -> None:
        """Handles a batch of a recalled message that its slot has not begun: puts it back into the plan.

        It does not count as a failure of the worker or of the batch.

        lease: its id. The other arguments are those of `handle_return`, which handles a batch that was not recalled: a worker
        that returns all of its work counts as faulty.
        """
        known = self._leases.get(lease)
        if known is not None and not known.is_recalled:
            self.handle_return(job, lease, batch, worker, reason)
            return
        ended = self._end_lease(job, lease)
        if ended is not None:
            self._shares.correct_charge(ended.kind, job.share, -ended.charged_s)
            job.requeue(ended.batch or batch)

    def handle_card_return(self, job: ActiveJob, lease: str, batch: Range, worker: str, reason: str) -> None:
        """Handles a batch that a graphics card cannot render: puts it back into the plan.

        From then on, that worker's cards get no batches of this job. lease: its id. reason: error sentence of the worker.
        """
        ended = self._end_lease(job, lease)
        if ended is None:
            return
        if worker not in job.card_refusals:
            log.info("job %s: %s", job.id, reason, extra=ids(job=job.id, batch=lease, worker=worker))
            job.history.log.add_line(f"{worker}: {reason}")
        job.card_refusals.add(worker)
        job.requeue(ended.batch or batch)

    def _end_lease(self, job: ActiveJob, lease: str) -> Lease | None:
        """Ends a lease of this job and returns it; None if it has already ended or belongs to another job."""
        known = self._leases.get(lease)
        return self._leases.end(lease) if known is not None and known.owner == job.id else None

    def withdraw(self, job: ActiveJob, frame: int | None = None) -> None:
        """Withdraws the queued batches of a job or of one of its frames, and ends the leases of all its outstanding batches.

        Results of batches that are already with a worker are still accepted, but the plan treats those batches as lost.
        """
        mine = [
            lease
            for lease in self._leases.leases_of(job.id)
            if frame is None or (lease.batch is not None and lease.batch.frame == frame)
        ]
        for queue in {lease.queue for lease in mine}:
            try:
                taken = self._dispatcher.withdraw(queue, {lease.message for lease in mine})
                mine += [lease for lease in self._leases.leases_of(job.id) if lease.message in taken and lease not in mine]
                if kept := {lease.message for lease in mine if lease.queue == queue and lease.message_s} - taken:
                    for lease in self._leases.leases_of(job.id):  # recalled messages may have batches of other frames
                        lease.is_recalled = lease.is_recalled or lease.message in kept
                    self._dispatcher.recall(kept)
            except redis.RedisError as error:
                log.warning("batches of job %s stay in the queue: %s", job.id, error, extra=ids(job=job.id))
        for lease in mine:
            self._leases.end(lease.id)
            if lease.batch is not None:
                job.requeue(lease.batch)

    def review_leases(self, results: Results) -> None:
        """Dispatches overdue and lost batches again. Fails jobs whose batches were lost too often. Called once a second.

        A batch whose answer may be among unread results is not lost. Raises redis.RedisError.
        """
        self._sites.withdraw_unserved(self._jobs)
        idle = cache(self._has_idle_slots)
        rests = cache(lambda id, kind: not (job := self._jobs[id]).knows_cost or job.agenda.next_frame(kind) is None)
        for lease, fate in self._missing.find_lost(self._jobs, results, self._pace.transit_s):
            job = self._jobs.get(lease.owner)
            if lease.batch is None or job is None or self._leases.get(lease.id) is None:
                continue  # ended together with another lease of its job or frame
            if fate is not LossVerdict.LATE:
                self._handle_loss(job, lease, lease.batch, fate)
            # no other work is left for idle slots
            elif rests(job.id, lease.kind) and idle(lease.kind) and not self._pace.unread_results:
                lease.doubled = True
                self.doubled += 1
                job.requeue(lease.batch)

    def _quarantine_if_others_succeed(self, worker: str) -> None:
        """Quarantines a worker whose batches fail while others render theirs, unless no other worker is ready."""
        others = self._other_ready_workers(worker)
        failures = self.suspicion.failures_of(worker, others)
        if others and failures >= FAILURES_ALLOWED:
            log.warning("worker %s is quarantined after %d failures", worker, failures, extra=ids(worker=worker))
            reason = Sentence(
                "worker-quarantined-failures",
                "Quarantined: {failures} of its batches failed while others rendered theirs. Check its log, then resume it.",
                failures=failures,
            )
            self.quarantine(worker, reason)

    def quarantine(self, worker: str, reason: str) -> None:
        """Pauses a worker until a user resumes it. reason: shown to users."""
        with suppress(redis.RedisError):  # the worker fails again and is paused then
            self._workers.pause(worker, reason)
            self._workers.refresh(now=True)

    def _other_ready_workers(self, worker: str) -> list[str]:
        """Returns the names of the other ready workers of the same kind; empty if the worker itself is not ready."""
        kinds = {report.name: report.kind for report in self._workers.roster.ready_reports()}
        return [name for name, kind in kinds.items() if kind == kinds.get(worker) and name != worker]

    def _handle_loss(self, job: ActiveJob, lease: Lease, batch: Range, fate: LossVerdict) -> None:
        self._leases.end(lease.id)
        self.lost += 1
        trouble = job.trouble.setdefault(batch, BatchFailures())
        trouble.losses += fate.counts_as_loss
        job.history.add_event("lost", lease.holder or "")
        said, known = (job.id, lease.holder, batch, fate.value), ids(job=job.id, batch=lease.id, worker=lease.holder)
        log.info("job %s: a batch was lost (%s, %s): %s; it is dispatched again", *said, extra=known)
        job.history.log.add_line(f"that was {batch_description(batch)} ({fate.value}), lost {trouble.losses} times so far")
        job.requeue(batch)
        if trouble.losses >= LOSSES_ALLOWED:
            where = job.film.tiles[batch.tile][:2]
            sentence = Sentence(
                "samples-lost-repeatedly",
                "The samples {first} to {last} of the tile at {where} were lost {losses} times. Check the "
                "workers' logs; set the job to running to try again.",
                first=batch.first,
                last=batch.first + batch.count - 1,
                where=where,
                losses=trouble.losses,
            )
            self.fail_batch(job, batch, sentence)

    def fail_batch(self, job: ActiveJob, batch: Range, error: str, command: str | None = None) -> None:
        """Fails the job of a still image, or one frame of a shot, because a batch cannot be rendered.

        command: the worker's command line that reproduces the error.
        """
        if job.shot is None:
            self._bulkheads.give_verdict(job.id, error, command)
            return
        frame = job.frames[batch.frame]
        self.withdraw(job, frame.key)
        if not frame.is_over:
            again = (
                Sentence("frame-reproduce", "To see it again: {command}", command=reproduce(command, job, frame))
                if command
                else ""
            )
            self._bulkheads.run(job.id, Step.HAND_OUT, lambda: job.fail_frame(frame, joined_sentences(error, again)))

    def _has_idle_slots(self, kind: str) -> bool:
        return self._workers.roster.cpu_slots(kind) > self._leases.occupied_slots(kind)


def batch_description(batch: Range) -> str:
    """Returns a description of a batch for log lines."""
    frame = frame_text(frame_number(batch.frame))
    return f"samples {batch.first} to {batch.first + batch.count - 1} of tile {batch.tile}, frame {frame}"
