"""Handles the messages from workers, grouped by job or scene.

A message that cannot be stored at present (its film is locked, the database is full) stays in the stream and in memory, and is
retried. So no batch is rendered twice for that reason, and a fault of one job's film does not delay the messages of other jobs.

An invalid message, or one whose handling raises any other error, is moved to the dead-letter list: it is counted, stored in a
bounded list and deleted from the stream. Its work is dispatched again.
"""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

from renderer.library_messages import library_message
from renderer.sentences import Sentence, joined_sentences
from service.events import Events, ItemKind, TilesChanged
from service.scheduling.artifacts.artifacts import ArtifactTasks
from service.scheduling.artifacts.scene_preparation import Progress
from service.scheduling.artifacts.unfit_machines import MachineFault
from service.scheduling.dispatching.batch_outcomes import batch_description
from service.scheduling.dispatching.pacing import BatchSizing
from service.scheduling.dispatching.scheduler import Scheduler
from service.scheduling.faults.bulkhead import Bulkheads, Step, is_message_fault
from service.scheduling.fleet.dead_letters import DeadLetters
from service.scheduling.incoming.merging import ReceivedBatch, batch_of, merge
from service.scheduling.incoming.messages import (
    SAME_RELEASE,
    BatchDone,
    BatchFailed,
    BatchReturned,
    FrameFailed,
    FramePrepared,
    FramesReturned,
    Message,
    PrepareDone,
    PrepareFailed,
    PrepareProgress,
    PrepareReturned,
    PrepareStarted,
    ThumbnailMade,
    Unusable,
    Wake,
    parse_message,
)
from service.scheduling.incoming.results import Entry, Results
from service.scheduling.jobs import traces
from service.scheduling.jobs.active_job import ActiveJob
from service.scheduling.jobs.batch_failures import FAILURES_ALLOWED, BatchFailures
from service.scheduling.jobs.job_log import JobLogs
from service.scheduling.jobs.plan import Range
from service.scheduling.jobs.tile_log import tile_log_line
from service.scheduling.lifecycle import Lifecycle
from service.scheduling.trust.trust import Trust
from telemetry.log_lines import ids

__all__ = ["Answers"]

RESUME_ADVICE = Sentence("advice-resume", "Then resume it.")  # by a worker of another release
COUNT_UNREAD_EVERY_S = 0.5  # interval of counting unread results


log = logging.getLogger(__name__)


@dataclass(frozen=True)
class _PendingAnswer:
    entry: Entry
    message: Message

    @property
    def sums(self) -> bytes | None:
        return self.entry.result.sums if self.entry.result is not None else None


class _MergedSums(NamedTuple):
    arrived: ReceivedBatch
    answer: _PendingAnswer


class Answers:
    """Reads messages from the stream, stores their content, and deletes stored messages. Used only by the engine's thread."""

    def __init__(
        self,
        results: Results,
        bulkheads: Bulkheads,
        scheduler: Scheduler,
        lifecycle: Lifecycle,
        artifact_tasks: ArtifactTasks,
        trust: Trust,
        pace: BatchSizing,
        logs: JobLogs,
        dead_letters: DeadLetters,
        record_change: Callable[[ItemKind, str], None],
        events: Events,
        on_plan_update: Callable[[ActiveJob], None],
    ) -> None:
        """Stores the parameters.

        dead_letters: list of the messages that could not be handled.
        record_change: records the change of an item, to be published with the next snapshot.
        on_plan_update: called with a job after its plan was updated from its film.
        """
        self._results = results
        self._bulkheads = bulkheads
        self._scheduler = scheduler
        self._outcomes = scheduler.outcomes
        self._lifecycle = lifecycle
        self._artifact_tasks = artifact_tasks
        self._trust = trust
        self._pace = pace
        self._logs = logs
        self._dead_letters = dead_letters
        self._record_change = record_change
        self._events = events
        self._on_plan_update = on_plan_update
        self._kept: dict[str, list[_PendingAnswer]] = {}  # by job or scene: read but not stored
        self._stored: list[Entry] = []  # to be deleted from the stream
        self._overlooked = False
        self._last_gathered = 0.0
        self._last_counted = 0.0  # time of the latest count of unread results
        self._batches = 0  # number of batches in the latest results
        self.counts: Counter[str] = Counter()  # batches merged, dropped, failed; and their results

    def read_answers(self, block_ms: int) -> None:
        """Reads new messages, and stores all pending messages that can be stored at present.

        Waits at most `block_ms` milliseconds for messages. Raises redis.RedisError.
        """
        self._wait_for_results()
        with self._pace.measuring():
            entries = self._results.read(block_ms)
            begun = time.monotonic()
            self._handle_entries(entries)
        sizes = [len(entry.result.sums) for entry in entries if entry.result is not None and entry.result.sums is not None]
        results = len(sizes)
        self.counts["results"] += results
        self.counts["result_bytes"] += sum(sizes)
        self._pace.record_results(results, self._batches, time.monotonic() - begun)
        self._batches = 0

    def count_unread(self) -> None:
        """Counts the unread results for the pacing, if that is due. Raises redis.RedisError."""
        is_due = self._results.was_full or time.monotonic() - self._last_counted >= COUNT_UNREAD_EVERY_S
        if self._results.size and is_due:
            self._last_counted = time.monotonic()
            unread = self._results.length() - sum(map(len, self._kept.values()))
            self._pace.record_unread(max(unread, 0), self._results.size)

    def _wait_for_results(self) -> None:
        """Sleeps until `BatchSizing.gather_s` seconds have passed since the last call.

        Results of the same tile that arrive in the meantime are then stored together.
        """
        left_s = self._last_gathered + self._pace.gather_s - time.monotonic()
        if left_s > 0:
            time.sleep(left_s)
        self._last_gathered = time.monotonic()

    def _handle_entries(self, entries: list[Entry]) -> None:
        known = {answer.entry.id for answers in self._kept.values() for answer in answers}
        for entry in entries:
            if entry.id not in known:
                self._group_by_owner(entry)
        for owner in list(self._kept):
            if self._lifecycle.is_awaited(owner):
                continue
            is_stored = self._bulkheads.run(owner, Step.RESULTS, partial(self._store_answers, owner), self._needs_database(owner))
            if is_stored and (job := self._scheduler.jobs.get(owner)) is not None and job.is_done:
                self._lifecycle.record(job)
            if is_stored or owner in self._bulkheads.verdicts:
                self._stored += [answer.entry for answer in self._kept.pop(owner)]
        self._results.delete(self._stored)
        self._stored = []

    def reread_if_incomplete(self) -> None:
        """Reads the whole stream again if it has more entries than are pending in memory. Called once a second.

        That happens if Redis was unreachable during a deletion, or has lost data. Raises redis.RedisError.
        """
        more = self._results.length() > sum(map(len, self._kept.values())) and self._results.has_read(
            self._results.latest_position()
        )
        if more and self._overlooked:
            self._results.reread()
        self._overlooked = more and not self._overlooked

    def _group_by_owner(self, entry: Entry) -> None:
        try:
            message = parse_message(entry)
        except Unusable as error:
            self._dead_letters.add(entry.location, str(error), entry.fields, error.__cause__)
            self._stored.append(entry)
            return
        if isinstance(message, Wake):
            self._stored.append(entry)
            return
        if isinstance(message, BatchDone):
            self._batches += len(message.pieces)
            for piece in message.pieces:
                self._outcomes.mark_answered(message.job, piece.batch)
        elif isinstance(message, PrepareDone | PrepareFailed | PrepareReturned):
            self._artifact_tasks.preparing.mark_answered(message.scene, message.kind)
        self._kept.setdefault(message.owner, []).append(_PendingAnswer(entry, message))

    def _needs_database(self, owner: str) -> bool:
        """Returns True if storing the pending messages of a job or scene (`owner`) requires the database."""
        return any(isinstance(answer.message, PrepareDone | PrepareFailed | ThumbnailMade) for answer in self._kept[owner])

    def _store_answers(self, owner: str) -> None:
        """Stores the pending messages of a job or a scene (`owner`).

        Each stored message is removed from the list, even if a later one raises an error.
        """
        answers = self._kept[owner]
        if owner in self._scheduler.jobs:
            self._merge(owner)
        while answers:
            answer = answers[0]
            if not isinstance(answer.message, BatchDone):
                self._handle_isolated(answer.entry, answer.message, partial(self._dispatch, answer.message))
            self._stored.append(answers.pop(0).entry)

    def _handle_isolated(
        self, entry: Entry, message: Message | None, action: Callable[[], object], fallback: Callable[[], object] | None = None
    ) -> None:
        """Handles one message by calling `action`. Moves the message to the dead-letter list if it caused an error.

        message: the decoded message, whose work is then dispatched again; None to dispatch nothing. fallback: called after the
        message was moved, if not None. Errors that the message did not cause (of Redis, the database, the machine, a film or a
        job) are raised.
        """
        try:
            action()
        except Exception as error:
            if not is_message_fault(error):
                raise
            self._dead_letters.add(entry.location, error, entry.fields, error)
            if fallback is not None:
                fallback()
            if message is not None:
                self._requeue_work(message, library_message(error))

    def _requeue_work(self, message: Message, reason: str) -> None:
        """Dispatches the work of a message again after the message was moved to the dead-letter list for this reason."""
        if isinstance(message, BatchDone):
            if (job := self._scheduler.jobs.get(message.job)) is not None:
                self._reject_sums(job, message, batch_of(message, job), reason)
        elif isinstance(message, PrepareDone | PrepareFailed | PrepareReturned) and self._artifact_tasks.preparing.reject_answer(
            message.scene, message.kind
        ):
            sentence = Sentence(
                "scene-answers-unusable", "The workers' answers about this scene cannot be used ({reason}).", reason=reason
            )
            self._lifecycle.prepare_failed(message.scene, message.kind, sentence)

    def _merge(self, id: str) -> None:
        job, answers = self._scheduler.jobs[id], self._kept[id]
        rendered = [answer for answer in answers if isinstance(answer.message, BatchDone) and answer.sums is not None]
        begun = time.time()
        try:
            arrived = self._add(job, rendered)
        except Exception as error:
            if not is_message_fault(error):
                raise
            arrived = []

            def add(answer: _PendingAnswer) -> None:
                arrived.extend(self._add(job, [answer]))

            for answer in rendered:  # one at a time, since only some may be faulty
                self._handle_isolated(answer.entry, answer.message, partial(add, answer))
        spans = (each for answer in rendered if isinstance(answer.message, BatchDone) for each in answer.message.traceparents)
        traces.record_merge_span(job, begun, len(arrived), spans)
        self._stored += [answer.entry for answer in answers if isinstance(answer.message, BatchDone)]
        answers[:] = [answer for answer in answers if not isinstance(answer.message, BatchDone)]
        self._record_merge(job, arrived)

    def _add(self, job: ActiveJob, rendered: list[_PendingAnswer]) -> list[_MergedSums]:
        """Merges rendered batches into a job's film: all of them, or none if an error is raised."""
        entries = {id(answer.message): answer for answer in rendered}
        sums = [(answer.message, answer.sums or b"") for answer in rendered if isinstance(answer.message, BatchDone)]
        kept = self._trust.mergeable_answers(job, sums)
        return [_MergedSums(each, entries[id(each.message)]) for each in merge(job, kept)]

    def _record_merge(self, job: ActiveJob, arrived: list[_MergedSums]) -> None:
        """Updates leases, logs and statistics after batches were merged into the film, and publishes the changed tiles."""
        tiles: dict[int, set[int]] = {}
        with_bad: set[int] = set()  # frames with new discarded samples
        for each, answer in arrived:
            noted = partial(self._record_batch, job, each, answer.sums or b"")
            self._handle_isolated(answer.entry, None if each.taken else each.message, noted, partial(self._end_leases, job, each))
            if each.fault is None and each.taken and each.batch is not None:
                tiles.setdefault(each.batch.frame, set()).add(each.batch.tile)
                if each.message.bad_count:
                    with_bad.add(each.batch.frame)
        for frame in with_bad:
            job.frames[frame].bad_samples = job.film.bad_count(frame)
            job.mark_changed(job.frames[frame])
        if arrived:
            job.advance_clock(job.state == "running")
            for frame, changed in tiles.items():
                self._events.publish(TilesChanged(job.id, frame, changed))
            self._record_change("job", job.id)
        job.update_from_film()
        self._on_plan_update(job)
        if job.agenda.new_goals:
            self._lifecycle.record(job)

    def _end_leases(self, job: ActiveJob, received: ReceivedBatch) -> None:
        """Ends the leases of a merged batch, and updates its job. Called if the full bookkeeping of the batch has failed."""
        for piece in received.message.pieces if received.taken and received.batch is not None else ():
            assert received.batch is not None
            lease = self._scheduler.leases.end(piece.batch)
            card = lease.only if lease is not None and lease.is_of_card else ""
            job.record_result(received.batch._replace(first=piece.first, count=piece.count), piece.seconds, card)

    def _record_batch(self, job: ActiveJob, received: ReceivedBatch, sums: bytes) -> None:
        if received.taken and received.batch is not None:
            self._trust.consider_verification(job, received.message, received.batch, sums)
        pieces = received.message.pieces
        if received.fault is not None and received.batch is not None:
            self._reject_sums(job, received.message, received.batch, received.fault)
            return
        self.counts["merged" if received.taken else "dropped"] += len(pieces)
        for piece in pieces:
            batch = received.batch and received.batch._replace(first=piece.first, count=piece.count)
            self._outcomes.end_batch(job, piece.batch, batch, piece.seconds, piece.worker or received.message.worker)
        self._log_batch(job, received)

    def _reject_sums(self, job: ActiveJob, message: BatchDone, run: Range | None, reason: str) -> None:
        """Records sums that cannot be decoded or merged as a failure of their batch on the worker that sent them.

        run: the samples of the message; None if the job does not need them. A joint result counts as one failure, and against
        no worker if several contributed to it.
        """
        for number, piece in enumerate(message.pieces):
            if run is None:
                self._outcomes.end_batch(job, piece.batch, None, 0.0, piece.worker or message.worker)
                continue
            self.counts["failed"] += 1
            batch = run._replace(first=piece.first, count=piece.count)
            sender, is_suspect = piece.worker or message.worker, number == 0 and len(message.senders) == 1
            said = Sentence(
                "worker-message-unusable",
                "A message of {sender} about it cannot be used ({reason}).",
                sender=sender,
                reason=reason,
            )
            trouble = self._outcomes.handle_failure(job, piece.batch, batch, sender, said, None, is_suspect=is_suspect)
            if trouble is not None:
                self._fail_batch(job, batch, trouble)

    def _fail_batch(self, job: ActiveJob, batch: Range, trouble: BatchFailures) -> None:
        sentence = Sentence(
            "batch-failed-repeatedly", "A batch failed {count} times: {error}", count=len(trouble.workers), error=trouble.error
        )
        self._outcomes.fail_batch(job, batch, sentence, trouble.reproduce)

    def _log_batch(self, job: ActiveJob, received: ReceivedBatch) -> None:
        """Logs a batch in the log of its tile. If its slot reported warnings, also logs them in the job's log."""
        said, batch = received.message, received.batch
        if batch is not None:
            seconds = sum(piece.seconds for piece in said.pieces)
            text = tile_log_line(", ".join(said.senders), said.first, said.count, seconds, said.took, said.lines)
            self._logs.tiles.add_line(job.id, batch.frame, batch.tile, text)
            for line in said.lines:
                job.history.log.add_line(f"{said.worker}, {batch_description(batch)}: {line}")

    def _dispatch(self, message: Message) -> None:
        match message:
            case BatchFailed():
                self._handle_failure(message)
            case BatchReturned():
                job = self._scheduler.jobs.get(message.job)
                batch = batch_of(message, job) if job else None
                if job is not None and batch is not None:
                    handle = self._outcomes.handle_card_return if message.for_cpu else self._outcomes.handle_return
                    if message.recalled:
                        handle = self._outcomes.handle_recalled
                    handle(job, message.batch, batch, message.worker, message.error)
                    self._record_change("job", job.id)
            case PrepareStarted():
                self._artifact_tasks.preparing.handle_progress(
                    message.scene, message.kind, message.worker, Progress("Reading", 0.0)
                )
                self._record_change("scene", message.scene)
            case PrepareProgress():
                progress = Progress(message.step, message.fraction, message.preview)
                self._artifact_tasks.preparing.handle_progress(message.scene, message.kind, message.worker, progress)
                self._record_change("scene", message.scene)
            case PrepareDone():
                self._lifecycle.handle_prepared(message.scene, message.info)
                self._record_change("scene", message.scene)
            case ThumbnailMade():
                if self._lifecycle.add_thumbnail(message.scene, message.thumbnail):
                    self._record_change("scene", message.scene)
            case PrepareFailed():
                self._lifecycle.prepare_failed(message.scene, message.kind, message.error)
            case PrepareReturned():
                unfit = MachineFault(message.worker, message.error, message.passing) if message.unfit else None
                self._artifact_tasks.preparing.handle_return(message.scene, message.kind, message.error, unfit)
                self._record_change("scene", message.scene)
            case FramePrepared() | FrameFailed():
                self._lifecycle.handle_frame_answer(message)
            case FramesReturned():
                if (job := self._scheduler.jobs.get(message.job)) is not None:
                    log.info("job %s: %s", job.id, message.error, extra=ids(job=job.id, worker=message.worker))
                    unfit = MachineFault(message.worker, message.error, message.passing) if message.unfit else None
                    job.history.log.add_line(str(unfit or message.error))
                    self._artifact_tasks.moments.handle_return(job, message.work, unfit)
                    self._record_change("job", job.id)
            case _:
                self._artifact_tasks.handle_artifact(message)

    def _handle_failure(self, message: BatchFailed) -> None:
        job = self._scheduler.jobs.get(message.job)
        batch = batch_of(message, job) if job else None
        if job is None or batch is None:
            return
        if message.error.endswith(SAME_RELEASE):
            self._handle_misunderstood(job, batch, message)
            return
        self.counts["failed"] += 1
        trouble = self._outcomes.handle_failure(
            job, message.batch, batch, message.worker, message.error, message.reproduce, message.trace
        )
        if trouble is not None:
            self._fail_batch(job, batch, trouble)

    def _handle_misunderstood(self, job: ActiveJob, batch: Range, message: BatchFailed) -> None:
        """Dispatches a batch again if a worker of another release did not understand it.

        This does not count against the job, since other workers may render the batch. A worker that does it repeatedly is
        quarantined.
        """
        lease = self._scheduler.leases.get(message.batch)
        if lease is None or lease.owner != job.id:
            return  # not a batch that was handed out
        self._outcomes.handle_return(job, message.batch, batch, message.worker, message.error)
        if self._outcomes.suspicion.record_misunderstood(message.worker) >= FAILURES_ALLOWED:
            self._outcomes.quarantine(message.worker, joined_sentences(message.error, RESUME_ADVICE))
            if not job.samples:  # no sample of the job is from that release
                self._outcomes.withdraw(job)
                job.kind = None
        self._record_change("job", job.id)
