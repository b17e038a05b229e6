"""Dispatching to workers with graphics cards, each of which has its own queue (protocol/card.py).

A slot with a card renders some hundred times the samples of a CPU slot. So it gets messages with batches of many tiles, sized
by the measured cost of a sample on that worker's cards. Each batch has enough samples of its tile to make its result worth
sending. The sums of each batch are sent as soon as they are known, so pictures are updated while a message is rendered, and if
a card fails, only unsent sums are lost. Towards the end of a job a message takes at most a third of the remaining time, so that
all slots end together.
"""

from __future__ import annotations

from dataclasses import dataclass

from protocol.card import card_queue
from service.scheduling.dispatching.batch_groups import BatchGroup
from service.scheduling.dispatching.leases import Leases
from service.scheduling.dispatching.pacing import BatchSizing
from service.scheduling.fleet.workers import Workers
from service.scheduling.jobs.active_job import ActiveJob
from service.scheduling.jobs.plan import Range

__all__ = ["CardWorker", "CardWorkers"]

MESSAGES_PER_SLOT = 2  # one in progress, and one that waits
UNMEASURED_BATCHES = 16  # of a message before the cost of a sample is known
MAX_BATCHES = 512  # of a message


@dataclass
class CardWorker:
    """A ready worker whose slots have graphics cards. room: how many more messages it accepts."""

    name: str
    queue: str
    slots: int
    room: int

    def accepts(self, job: ActiveJob) -> bool:
        """Returns True if this worker's graphics cards may render a job.

        Returns False if the job's batches are rendered twice for verification, or if the cards cannot render the job.
        """
        return not job.verify and self.name not in job.card_refusals


class CardWorkers:
    """The workers with graphics cards that accept batches at present. Used only by the engine's thread."""

    def __init__(self, workers: Workers, leases: Leases, pace: BatchSizing) -> None:
        self._workers = workers
        self._leases = leases
        self._pace = pace

    def of_kind(self, kind: str) -> list[CardWorker]:
        """Returns the ready workers of this kind that have graphics cards."""
        is_full = self._pace.scaled_room(1000) <= 0  # too many results are unread
        found = []
        for report in self._workers.roster.with_cards(kind):
            queue = card_queue(report.name)
            room = 0 if is_full else MESSAGES_PER_SLOT * report.slots - self._leases.slots_waiting_in(queue)
            found.append(CardWorker(report.name, queue, report.slots, room))
        return found

    def meets_needs(self, worker: CardWorker, job: ActiveJob) -> bool:
        """Returns True if a worker meets a job's requirements."""
        offer = self._workers.roster.offers.get(worker.name)
        return job.needs is None or (offer is not None and job.needs.are_met(offer))

    def next_message(self, job: ActiveJob, kind: str, worker: CardWorker, cpu_slots: int) -> BatchGroup | None:
        """Returns a message with the next batches of a job for one slot with a graphics card; None if there are none.

        kind: worker kind. cpu_slots: number of CPU slots that may render the job too.
        """
        aim = job.card_target_s(self._pace.card_message_s(), cpu_slots, self._outstanding_s(job, kind))
        tile_s = self._pace.card_batch_s(aim, len(job.film.tiles))
        batches: list[Range] = []
        expected = 0.0
        while expected < aim and len(batches) < (MAX_BATCHES if job.card_sample_s(worker.name) else UNMEASURED_BATCHES):
            batch = job.next_for_card(worker.name, tile_s, kind)
            if batch is None:
                break
            expected += job.expected_s(batch, worker.name)
            batches.append(batch)
        return BatchGroup(batches, queue=worker.queue, only=worker.name, is_of_card=True) if batches else None

    def _outstanding_s(self, job: ActiveJob, kind: str) -> float:
        """Returns the duration, in seconds per slot, of a job's outstanding batches on graphics cards of this worker kind."""
        slots = sum(report.slots for report in self._workers.roster.with_cards(kind))
        out = (lease.charged_s for lease in self._leases.leases_of(job.id) if lease.is_of_card and lease.takes_a_slot)
        return sum(out) / max(slots, 1)
