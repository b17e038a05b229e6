"""The scheduler: dispatches batches by priority and fair shares, a limited number in advance, and lost ones again."""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import count

import redis

from protocol.card import CardBatches
from renderer.frames import frame_number, frame_text
from renderer.sentences import Sentence, joined_sentences
from service.errors import QueueError
from service.scheduling.dispatching.batch_groups import BatchGroup, SlotGroup, batch_message, joint_message, next_batch_groups
from service.scheduling.dispatching.cards import CardWorker, CardWorkers
from service.scheduling.dispatching.dispatcher import Dispatcher
from service.scheduling.dispatching.job_queue import JobQueue
from service.scheduling.dispatching.leases import Lease, Leases
from service.scheduling.dispatching.lost_batches import LossVerdict, LostLeaseFinder
from service.scheduling.dispatching.pacing import MESSAGE_SHARE, BatchSizing
from service.scheduling.dispatching.sites import ReadySite, Sites
from service.scheduling.faults.bulkhead import Bulkheads, Step
from service.scheduling.faults.suspicion import Suspicion
from service.scheduling.fleet.workers import Workers
from service.scheduling.incoming.results import Results
from service.scheduling.jobs.active_job import ActiveJob
from service.scheduling.jobs.batch_failures import FAILURES_ALLOWED, LOSSES_ALLOWED, BatchFailures
from service.scheduling.jobs.noise_budget import NoiseBudget
from service.scheduling.jobs.plan import Range
from service.scheduling.jobs.reproduce import reproduce
from service.scheduling.jobs.shares import ShareQueue, Shares
from service.settings import Settings
from telemetry.log_lines import ids

__all__ = ["Scheduler", "batch_description"]

FEW_SLOTS_TIMEOUT_S = 5.0
MAX_UNMEASURED_BATCHES = 32  # batches handed out before the duration of one is known, in addition to one sample of every tile
CLOCK_TOLERANCE_S = 60.0  # seconds of tolerance for a worker's clock
RETURNED_PAUSE_S = 1.0  # seconds before the only worker gets a returned batch again

log = logging.getLogger(__name__)

StartJob = Callable[[ActiveJob, str], bool]


@dataclass
class QueueCapacity:
    """Capacity of the workers that serve a queue. slots: their slots. room: how many more messages may be sent to them."""

    slots: int
    room: int


class Scheduler:
    """Selects the batches that are rendered next. Used only by the engine's thread."""

    def __init__(
        self, settings: Settings, dispatcher: Dispatcher, workers: Workers, bulkheads: Bulkheads, pace: BatchSizing
    ) -> None:
        self._settings = settings
        self._pace = pace
        self.verify = settings.verify  # fraction of batches rendered twice, unless the job sets another
        self._dispatcher = dispatcher
        self._workers = workers
        self._bulkheads = bulkheads
        self.leases = Leases()
        self._missing = LostLeaseFinder(self.leases, workers, dispatcher)
        self.jobs: dict[str, ActiveJob] = {}
        self.job_queue = JobQueue(workers, self.jobs)
        self.shares = Shares()
        self.sites = Sites(workers, self.leases, dispatcher, pace)
        self._ready_sites: list[ReadySite] = []  # sites, during one call of `dispatch_work`
        self._cards = CardWorkers(workers, self.leases, pace)
        self.suspicion = Suspicion()
        self.distrusted: set[str] = set()  # workers whose results no film accepts (trust/trust.py)
        self.looks = NoiseBudget()
        self.checks: Counter[str] = Counter()  # pending verifications of batches, by job
        self._sent: list[Lease] = []  # leases of one call of `dispatch_work`
        self._is_contended = False  # whether other work waits for the slots of the worker kind that is being served
        self._turn = count(1)
        self.lost = 0  # batches that were handed out again
        self.doubled = 0  # duplicates of straggling batches

    def dispatch_work(self, start: StartJob, others_wait: bool = False) -> None:
        """Dispatches batches until each worker kind has its maximum number of outstanding messages. Raises QueueError.

        start(job, kind): starts a job on workers of this kind; returns False if the job is not ready. others_wait: whether work
        other than batches and live views waits for slots.
        """
        for kind in sorted({report.kind for report in self._workers.roster.ready_reports()}):
            slots = self._workers.roster.cpu_slots(kind)
            room = self._pace.scaled_room(self._window(slots, kind) - self.leases.occupied_slots(kind))
            cards = self._cards.of_kind(kind)
            has_room, has_long = room > 0 or any(card_worker.room > 0 for card_worker in cards), self.leases.has_long(kind)
            turns = self.job_queue.by_priority(kind) if has_room or has_long else {}
            self._is_contended = others_wait or self._pace.is_pressed() or self._has_job_without_slot(turns)
            if has_long and self._is_contended:
                self._recall_long_messages(kind)
                room = self._pace.scaled_room(self._window(slots, kind) - self.leases.occupied_slots(kind))
            if not turns or not (has_room or room > 0):
                continue
            self._sent.clear()
            self._ready_sites = self.sites.ready_sites(kind, self._settings.window_per_slot)
            try:
                with self._dispatcher.send_together():
                    self._fill_cards(cards, turns, kind, slots, start)
                    held = self.leases.slots_by_job()
                    shares_held = self.outstanding_by_share(held)
                    capacities: dict[str, QueueCapacity] = {}
                    for priority in sorted(turns, reverse=True):
                        queue = self.shares.queue_of(kind, turns[priority], held, shares_held)
                        room -= self._serve_priority(queue, kind, slots, room, start, capacities)
                        if room <= 0:
                            break
            except QueueError:
                self._end_unsent_leases()
                raise

    def _fill_cards(
        self, cards: list[CardWorker], turns: dict[int, list[ActiveJob]], kind: str, slots: int, start: StartJob
    ) -> None:
        """Dispatches batches to the workers `cards`, whose slots have graphics cards. Raises QueueError.

        turns: jobs by priority. kind: worker kind. slots: number of CPU slots of this kind. start(job, kind): starts a job on
        workers of this kind; returns False if the job is not ready.
        """
        for each in (job for jobs in turns.values() for job in jobs):
            each.card_rate = sum(
                card_worker.slots / cost
                for card_worker in cards
                if card_worker.accepts(each) and (cost := each.card_sample_s(card_worker.name)) > 0.0
            )
        for card_worker in cards:
            held = self.leases.slots_by_job()
            shares_held = self.outstanding_by_share(held)
            for priority in sorted(turns, reverse=True):
                queue = self.shares.queue_of(kind, turns[priority], held, shares_held)
                while card_worker.room > 0 and (job := queue.next_job()) is not None:
                    if not self._may_serve(job) or not self._cards.meets_needs(card_worker, job):
                        continue
                    if (
                        card_worker.accepts(job)
                        and not job.card_sample_s(card_worker.name)
                        and self.leases.slots_waiting_in(card_worker.queue)
                    ):
                        continue  # a second message before the first is measured would be too small
                    sent = len(self._sent)
                    dispatch_work = partial(self._dispatch_to_card, job, kind, card_worker, slots, start)
                    self._bulkheads.run(job.id, Step.HAND_OUT, dispatch_work, needs_database=job.state == "queued")
                    if new := self._sent[sent:]:
                        card_worker.room -= 1
                        queue.record_served(job, 1, sum(lease.charged_s for lease in new))

    def _dispatch_to_card(self, job: ActiveJob, kind: str, card_worker: CardWorker, cpu_slots: int, start: StartJob) -> None:
        """Dispatches one message to the worker `card_worker`, which has graphics cards. Raises QueueError.

        Does nothing if the job has no batch for it. cpu_slots: number of CPU slots. If none of them may render this job, the
        worker's own CPU renders what its graphics cards cannot.
        """
        if job.needs is not None:
            cpu_slots = self._workers.roster.slots_serving(job.needs.queue(kind), of_cpu=True).get(kind, 0)
        if (not card_worker.accepts(job) and cpu_slots) or not start(job, kind):
            return
        if card_worker.accepts(job):
            found = self._cards.next_message(job, kind, card_worker, cpu_slots)
            groups = [] if found is None else [found]
        else:
            batch_s = self._pace.batch_s(card_worker.slots, job.rendered_s / max(card_worker.slots, 1))
            message_s = MESSAGE_SHARE * batch_s
            slots = SlotGroup(kind, card_worker.slots, batch_s, several=True, joint=False, most=1, message_s=message_s)
            groups = next_batch_groups(job, slots)
            groups = [replace(group, queue=card_worker.queue, only=card_worker.name) for group in groups]
        self._send_all(job, kind, groups)

    def _has_job_without_slot(self, turns: dict[int, list[ActiveJob]]) -> bool:
        """Returns True if a job may wait for slots of other jobs: it has no message out, or not all priorities are equal.

        turns: the jobs by priority. Jobs that may not be dispatched now wait for no slot.
        """
        served = [[job for job in equals if self._may_serve(job)] for equals in turns.values()]
        jobs = [job for equals in served for job in equals]
        if len(jobs) < 2:
            return False
        held = self.leases.slots_by_job()
        return sum(map(bool, served)) > 1 or not all(held[job.id] for job in jobs)

    def _may_serve(self, job: ActiveJob) -> bool:
        return self._bulkheads.may_render(job.id) and time.monotonic() >= job.rests_until and not job.is_done

    def _end_unsent_leases(self) -> None:
        """Ends the leases of messages that may not have been sent, so that their batches are dispatched again.

        If a message was sent nevertheless, its batch may be rendered twice; the film accepts each batch only once.
        """
        for lease in self._sent:
            job = self.jobs.get(lease.owner)
            if self.leases.end(lease.id) is not None and job is not None and lease.batch is not None:
                self.shares.correct_charge(lease.kind, job.share, -lease.charged_s)
                job.requeue(lease.batch)

    def _serve_priority(
        self,
        queue: ShareQueue[ActiveJob],
        kind: str,
        slots: int,
        free_slots: int,
        start: StartJob,
        capacities: dict[str, QueueCapacity],
    ) -> int:
        """Dispatches batches of jobs of one priority for up to `free_slots` slots. Returns the number of slots used.

        queue: the jobs. kind: worker kind. slots: number of CPU slots of this kind. start(job, kind): starts a job on workers
        of this kind; returns False if the job is not ready. capacities: capacities of the queues of jobs with requirements, by
        queue; computed on demand.
        """
        handed_out = 0
        while handed_out < free_slots and (job := queue.next_job()) is not None:
            if not self._may_serve(job):
                continue
            capacity = (
                QueueCapacity(slots, free_slots)
                if job.needs is None
                else self._capacity_of(job.needs.queue(kind), kind, capacities)
            )
            if capacity.room <= 0:
                continue
            if not job.knows_cost and queue.held >= max(MAX_UNMEASURED_BATCHES, len(job.film.tiles)):
                continue  # single samples on many slots cost more than they gain
            sent = len(self._sent)
            dispatch_work = partial(self._dispatch_job, job, kind, capacity.slots, start, min(queue.left, capacity.room))
            self._bulkheads.run(job.id, Step.HAND_OUT, dispatch_work, needs_database=job.state == "queued")
            if new := self._sent[sent:]:
                taken = len({lease.slot_unit for lease in new})
                handed_out += taken
                capacity.room -= taken
                queue.record_served(job, taken, sum(lease.charged_s for lease in new))
        return handed_out

    def _window(self, slots: int, kind: str) -> int:
        return self._pace.window(slots, self._settings.window_per_slot, self._workers.roster.accepts_joint(kind))

    def _capacity_of(self, queue: str, kind: str, cache: dict[str, QueueCapacity]) -> QueueCapacity:
        """Returns the capacity of the workers that serve a queue of jobs with requirements.

        cache: capacities that were computed during the same call of `dispatch_work`, by queue.
        """
        if queue not in cache:
            slots = self._workers.roster.slots_serving(queue, of_cpu=True).get(kind, 0)
            window = self._window(slots, kind) if slots else 0
            cache[queue] = QueueCapacity(slots, window - self.leases.slots_waiting_in(queue))
        return cache[queue]

    def _dispatch_job(self, job: ActiveJob, kind: str, slots: int, start: StartJob, max_slots: int) -> None:
        """Dispatches the next batches of a job for at most `max_slots` slots, if it has any. Raises QueueError.

        slots: number of slots that may render the job. start(job, kind): starts the job on workers of this kind; returns False
        if it is not ready.
        """
        if not start(job, kind):
            return
        roster, batch_s = self._workers.roster, self._pace.batch_s(slots, job.rendered_s / max(slots, 1))
        several, joint = roster.accepts_several(kind), roster.accepts_joint(kind)
        max_run = self._pace.batches_of_a_tile(slots, joint)
        site = self._choose_site(job) if joint and max_run > 1 else None
        if site is not None:
            max_run, max_slots = self._pace.batches_of_a_site(site.slots), min(max_slots, site.room)
        message_s = whole_s = batch_s
        if job.shot is not None:
            is_recallable = not self._is_contended and roster.accepts_recall(kind)
            message_s = self._pace.message_s(batch_s, job.rendered_s / max(slots, 1), is_recallable)
            whole_s = min(message_s, self._pace.longest_message_s)
        groups = next_batch_groups(job, SlotGroup(kind, slots, batch_s, several, joint, max_run, max_slots, message_s, whole_s))
        if site is not None:
            hold_s = self._pace.site_hold_s(batch_s)
            groups = [message for group in groups for message in site.split_for_machines(group, hold_s)]
        self._send_all(job, kind, groups)

    def _send_all(self, job: ActiveJob, kind: str, groups: list[BatchGroup]) -> None:
        """Sends a job's messages. Puts the batches of messages that could not be sent back into the plan. Raises QueueError."""
        try:
            while groups:
                self._send(job, kind, groups[0])
                groups.pop(0)
        except BaseException:
            for batch in (batch for group in groups for batch in group.batches):
                job.requeue(batch)
            raise

    def _choose_site(self, job: ActiveJob) -> ReadySite | None:
        """Returns the site that accepts the most batches; None if there is none or if this job cannot be rendered at sites.

        At sites, sums of several workers are added up. Jobs with requirements or with verification are not rendered there.
        """
        if job.needs is not None or job.verify:
            return None
        return max((site for site in self._ready_sites if site.room > 0), key=lambda site: site.room, default=None)

    def _send(self, job: ActiveJob, kind: str, group: BatchGroup) -> None:
        """Sends the batches of one message, and creates their leases. Raises QueueError; then there are no leases."""
        batches, leases = group.batches, list[Lease]()
        expected = 0.0
        for batch in batches:
            seconds = job.expected_s(batch, group.only if group.is_of_card else "")
            expected += seconds
            trouble = job.trouble.get(batch)
            patience = max(self._settings.batch_deadline, 10 * expected) * 2 ** (trouble.losses if trouble else 0)
            leases.append(Lease(job.id, kind, batch, patience, expected, is_joint=group.is_joint))
            leases[-1].queue = group.queue or job.queue_name(kind)
            leases[-1].only, leases[-1].is_of_card = group.only, group.is_of_card
            leases[-1].charged_s = seconds or self._settings.batch_seconds
            leases[-1].message = leases[0].id
        if len(leases) > 1 and not group.is_joint and not group.is_of_card:
            for lease in leases:
                lease.message_s = expected
                lease.is_long = expected > self._pace.longest_message_s and not self._is_contended
        if group.is_joint:
            hold_s = self._pace.hold_s(expected / len(batches))
            self._dispatcher.send_joint(joint_message(job, leases, batches, hold_s, group.run), leases[0].queue)
        elif group.is_of_card:
            works = [batch_message(job, lease, batch) for lease, batch in zip(leases, batches, strict=True)]
            self._dispatcher.send_card(CardBatches(tuple(works)), leases[0].queue, leases[0].id)
        elif len(leases) == 1:
            self._dispatcher.send_batch(batch_message(job, leases[0], batches[0]), leases[0].queue)
        else:
            works = [batch_message(job, lease, batch) for lease, batch in zip(leases, batches, strict=True)]
            self._dispatcher.send_batches(works, leases[0].queue, leases[0].id)
        self._sent += leases
        for lease in leases:
            self.leases.add(lease)
        job.history.log.count_dispatched(len(batches))
        job.served = next(self._turn)

    def mark_answered(self, owner: str, lease: str) -> None:
        """Marks the lease of a batch whose sums were read. owner: job id. lease: lease id.

        The sums are stored once the film accepts them. Until then the lease cannot become lost.
        """
        known = self.leases.get(lease)
        if known is not None and known.owner == owner:
            self.leases.mark_answered(known)

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
            self.shares.correct_charge(ended.kind, job.share, seconds - ended.charged_s)
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
        known = self.leases.get(lease)
        if known is not None and not known.is_recalled:
            self.handle_return(job, lease, batch, worker, reason)
            return
        ended = self._end_lease(job, lease)
        if ended is not None:
            self.shares.correct_charge(ended.kind, job.share, -ended.charged_s)
            job.requeue(ended.batch or batch)

    def _recall_long_messages(self, kind: str) -> None:
        """Takes back the long messages of a worker kind, since other work waits for its slots.

        Those in a queue are withdrawn. The slots that render one return the batches that they have not begun. If Redis fails,
        the next call tries again.
        """
        out = self.leases.long_leases(kind)
        taken: set[str] = set()
        for lease in out:
            lease.is_recalled = True
        try:
            for queue in {lease.queue for lease in out}:
                taken |= self._dispatcher.withdraw(queue, {lease.message for lease in out})
            self._dispatcher.recall({lease.message for lease in out} - taken)
            self.leases.forget_long(kind)
        except redis.RedisError as error:
            log.warning("long messages are not recalled: %s", error)
        for lease in out:
            if lease.message in taken and lease.batch is not None and (job := self.jobs.get(lease.owner)) is not None:
                self.handle_recalled(job, lease.id, lease.batch, "", "")

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
        known = self.leases.get(lease)
        return self.leases.end(lease) if known is not None and known.owner == job.id else None

    def withdraw(self, job: ActiveJob, frame: int | None = None) -> None:
        """Withdraws the queued batches of a job or of one of its frames, and ends the leases of all its outstanding batches.

        Results of batches that are already with a worker are still accepted, but the plan treats those batches as lost.
        """
        mine = [
            lease
            for lease in self.leases.leases_of(job.id)
            if frame is None or (lease.batch is not None and lease.batch.frame == frame)
        ]
        for queue in {lease.queue for lease in mine}:
            try:
                taken = self._dispatcher.withdraw(queue, {lease.message for lease in mine})
                mine += [lease for lease in self.leases.leases_of(job.id) if lease.message in taken and lease not in mine]
                if kept := {lease.message for lease in mine if lease.queue == queue and lease.message_s} - taken:
                    for lease in self.leases.leases_of(job.id):  # of other frames, too
                        lease.is_recalled = lease.is_recalled or lease.message in kept
                    self._dispatcher.recall(kept)
            except redis.RedisError as error:
                log.warning("batches of job %s stay in the queue: %s", job.id, error, extra=ids(job=job.id))
        for lease in mine:
            self.leases.end(lease.id)
            if lease.batch is not None:
                job.requeue(lease.batch)

    def review_leases(self, results: Results) -> None:
        """Dispatches overdue and lost batches again. Fails jobs whose batches were lost too often. Called once a second.

        A batch whose answer may be among unread results is not lost. Raises redis.RedisError.
        """
        self.sites.withdraw_unserved(self.jobs)
        idle = cache(self._has_idle_slots)
        rests = cache(lambda id, kind: not (job := self.jobs[id]).knows_cost or job.agenda.next_frame(kind) is None)
        for lease, fate in self._missing.find_lost(self.jobs, results, self._pace.transit_s):
            job = self.jobs.get(lease.owner)
            if lease.batch is None or job is None or self.leases.get(lease.id) is None:
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
        self.leases.end(lease.id)
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
        return self._workers.roster.cpu_slots(kind) > self.leases.occupied_slots(kind)

    def connected_workers(self) -> set[str]:
        """Returns the names of the connected workers."""
        return set(self._workers.roster.reports)

    def outstanding_by_share(self, held: Counter[str]) -> Counter[str]:
        """Returns the number of outstanding messages of each share (user or project).

        held: number of outstanding messages of each job, by id.
        """
        found: Counter[str] = Counter()
        for id, messages in held.items():
            if (job := self.jobs.get(id)) is not None:
                found[job.share] += messages
        return found

    def frames_with_batches(self) -> set[tuple[str, int]]:
        """Returns the (job, frame) pairs that have outstanding batches."""
        return {(lease.owner, lease.batch.frame) for lease in self.leases if lease.batch is not None}


def batch_description(batch: Range) -> str:
    """Returns a description of a batch for log lines."""
    frame = frame_text(frame_number(batch.frame))
    return f"samples {batch.first} to {batch.first + batch.count - 1} of tile {batch.tile}, frame {frame}"
