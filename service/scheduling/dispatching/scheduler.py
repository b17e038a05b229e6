"""The scheduler: dispatches batches by priority and fair shares, a limited number in advance."""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import count

import redis

from protocol.card import CardBatches
from service.errors import QueueError
from service.scheduling.dispatching.batch_groups import BatchGroup, SlotGroup, batch_message, joint_message, next_batch_groups
from service.scheduling.dispatching.batch_outcomes import BatchOutcomes
from service.scheduling.dispatching.cards import CardWorker, CardWorkers
from service.scheduling.dispatching.dispatcher import Dispatcher
from service.scheduling.dispatching.job_queue import JobQueue
from service.scheduling.dispatching.leases import Lease, Leases
from service.scheduling.dispatching.pacing import MESSAGE_SHARE, BatchSizing
from service.scheduling.dispatching.sites import ReadySite, Sites
from service.scheduling.faults.bulkhead import Bulkheads, Step
from service.scheduling.fleet.workers import Workers
from service.scheduling.jobs.active_job import ActiveJob
from service.scheduling.jobs.noise_budget import NoiseBudget
from service.scheduling.jobs.shares import ShareQueue, Shares
from service.settings import Settings

__all__ = ["Scheduler"]

MAX_UNMEASURED_BATCHES = 32  # batches handed out before the duration of one is known, in addition to one sample of every tile

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
        self.jobs: dict[str, ActiveJob] = {}
        self.job_queue = JobQueue(workers, self.jobs)
        self.shares = Shares()
        self.sites = Sites(workers, self.leases, dispatcher, pace)
        self._ready_sites: list[ReadySite] = []  # sites, during one call of `dispatch_work`
        self._cards = CardWorkers(workers, self.leases, pace)
        self.distrusted: set[str] = set()  # workers whose results no film accepts (trust/trust.py)
        self.looks = NoiseBudget()
        self.checks: Counter[str] = Counter()  # pending verifications of batches, by job
        self._sent: list[Lease] = []  # leases of one call of `dispatch_work`
        self._is_contended = False  # whether other work waits for the slots of the worker kind that is being served
        self._turn = count(1)
        self.outcomes = BatchOutcomes(self.jobs, self.leases, self.shares, self.sites, dispatcher, workers, bulkheads, pace)

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
                self.outcomes.handle_recalled(job, lease.id, lease.batch, "", "")

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
