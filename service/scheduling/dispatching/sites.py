"""Sites whose machines add up their sums before they travel (protocol/site.py): which batches go to one, and what
becomes of waiting ones when nobody is left there.

A site pays off where consecutive batches of a tile go to it. So it has a queue of its own, that of jobs which need its tag
(needs.py): its workers take from it as well as from all others. A run of batches is handed out there in as many messages as
there are machines to take them. Nothing goes there while its reducer is away.
"""

from __future__ import annotations

import logging
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import redis

from protocol.joint import Run
from protocol.site import SITE
from service.scheduling.dispatching.batch_groups import Handful
from service.scheduling.dispatching.dispatch import Dispatcher
from service.scheduling.dispatching.leases import Lease, Leases
from service.scheduling.dispatching.pacing import MOST_JOINT, Pace
from service.scheduling.fleet.needs import Needs
from service.scheduling.fleet.workers import Workers
from service.scheduling.jobs.active_job import ActiveJob

__all__ = ["Place", "Sites"]

log = logging.getLogger(__name__)


@dataclass
class Place:
    """A site that takes batches: of workers of one kind. room: for how many slots it may have more."""

    name: str
    queue: str
    slots: int
    room: int

    def shared_out(self, handful: Handful, hold_s: float) -> list[Handful]:
        """A tile's batches for its machines, in messages of about the same length; others as they are."""
        if not handful.is_joint:
            return [handful]
        batches = handful.batches
        self.room -= len(batches)
        run = Run(self.name, batches[0].first, sum(batch.count for batch in batches), hold_s)
        messages = -(-len(batches) // MOST_JOINT)
        ends = [len(batches) * i // messages for i in range(messages + 1)]
        return [Handful(batches[begin:end], True, run, self.queue) for begin, end in pairwise(ends)]


class Sites:
    """Lives in the engine's thread."""

    def __init__(self, workers: Workers, leases: Leases, dispatcher: Dispatcher, pace: Pace) -> None:
        self._workers = workers
        self._leases = leases
        self._dispatcher = dispatcher
        self._pace = pace

    def needs(self) -> list[Needs]:
        """What workers are to serve, where their site has a reducer."""
        return [Needs((f"{SITE}{name}",)) for name in self._workers.roster.sites]

    def places(self, kind: str, per_slot: int) -> list[Place]:
        """The sites where workers of a kind are ready."""
        found = []
        for needs in self.needs():
            queue = needs.queue(kind)
            if slots := self._workers.roster.serving(queue).get(kind, 0):
                room = self._pace.window(slots, per_slot, joint=True) - self._leases.waiting_in(queue)
                found.append(Place(needs.tags[0].removeprefix(SITE), queue, slots, room))
        return found

    def review(self, jobs: Mapping[str, ActiveJob]) -> None:
        """Take back what waits where nobody takes it any more. Raises redis.RedisError."""
        elsewhere: defaultdict[str, list[tuple[ActiveJob, Lease]]] = defaultdict(list)
        for lease in self._leases:
            job = jobs.get(lease.owner)
            if job is not None and lease.batch is not None and not lease.has_arrived and lease.queue != job.queue(lease.kind):
                elsewhere[lease.queue].append((job, lease))
        for queue, out in elsewhere.items():
            if self._workers.roster.serving(queue):
                continue
            try:
                taken = self._dispatcher.take_back(queue, {lease.message for _, lease in out})
            except redis.RedisError as error:
                log.warning("batches for a site stay in its queue: %s", error)
                raise
            for job, lease in out:
                if lease.message in taken and lease.batch is not None and self._leases.end(lease.id) is not None:
                    job.lose(lease.batch)
