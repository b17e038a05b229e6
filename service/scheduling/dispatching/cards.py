"""Dispatching to workers with graphics cards, which have a queue each (protocol/card.py).

A slot with a card renders some hundred times the samples of a CPU slot. So it gets messages with batches of many tiles, sized by
the measured cost of a sample on that worker's cards; each batch has as many samples of its tile as make its result worth sending.
The sums of each batch are sent as soon as they are known, so pictures are updated while a message is rendered, and if a card
fails, only sums that were not sent are lost. Towards the end of a job a message takes at most a third of the remaining time, so
that all slots end together.
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

__all__ = ["CardPlace", "CardPlaces"]

MESSAGES_PER_SLOT = 2  # one in progress, and one that waits
UNMEASURED_BATCHES = 16  # of a message before the cost of a sample is known
MAX_BATCHES = 512  # of a message


@dataclass
class CardPlace:
    """A ready worker whose slots have graphics cards. room: how many more messages it accepts."""

    worker: str
    queue: str
    slots: int
    room: int

    def accepts(self, job: ActiveJob) -> bool:
        """Returns True if this worker's graphics cards may render a job.

        False if the job's batches are rendered twice for verification, or if the worker has refused the job for its cards.
        """
        return not job.verify and self.worker not in job.card_refusals


class CardPlaces:
    """The workers with graphics cards that accept batches at present. Used only by the engine's thread."""

    def __init__(self, workers: Workers, leases: Leases, pace: BatchSizing) -> None:
        self._workers = workers
        self._leases = leases
        self._pace = pace

    def places(self, kind: str) -> list[CardPlace]:
        """Returns the workers of this kind."""
        is_full = self._pace.scaled_room(1000) <= 0  # too many results are unread
        found = []
        for report in self._workers.roster.with_cards(kind):
            queue = card_queue(report.name)
            room = 0 if is_full else MESSAGES_PER_SLOT * report.slots - self._leases.slots_waiting_in(queue)
            found.append(CardPlace(report.name, queue, report.slots, room))
        return found

    def meets_needs(self, place: CardPlace, job: ActiveJob) -> bool:
        """Returns True if a worker meets a job's requirements."""
        offer = self._workers.roster.offers.get(place.worker)
        return job.needs is None or (offer is not None and job.needs.are_met(offer))

    def next_message(self, job: ActiveJob, kind: str, place: CardPlace, cpu_slots: int) -> BatchGroup | None:
        """Returns the message with the next batches of a job for one slot with a graphics card; None if there are none.

        cpu_slots: number of CPU slots that may render the job.
        """
        aim = job.card_target_s(self._pace.card_message_s(), cpu_slots, self._outstanding_s(job, kind))
        tile_s = self._pace.card_batch_s(aim, len(job.film.tiles))
        batches: list[Range] = []
        expected = 0.0
        while expected < aim and len(batches) < (MAX_BATCHES if job.card_sample_s(place.worker) else UNMEASURED_BATCHES):
            batch = job.next_for_card(place.worker, tile_s, kind)
            if batch is None:
                break
            expected += job.expected_s(batch, place.worker)
            batches.append(batch)
        return BatchGroup(batches, queue=place.queue, only=place.worker, is_of_card=True) if batches else None

    def _outstanding_s(self, job: ActiveJob, kind: str) -> float:
        """Returns the duration, in seconds per slot, of the batches of a job that were sent to this kind's cards and are
        outstanding.
        """
        slots = sum(report.slots for report in self._workers.roster.with_cards(kind))
        out = (lease.charged_s for lease in self._leases.leases_of(job.id) if lease.is_of_card and lease.takes_a_slot)
        return sum(out) / max(slots, 1)
