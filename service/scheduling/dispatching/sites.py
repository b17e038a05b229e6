"""Dispatching to sites: groups of machines that add up their sums before they send them (protocol/site.py).

A site is efficient for consecutive batches of one tile. Its workers serve the queue of jobs that require the site's tag
(needs.py), in addition to all other queues. Consecutive batches are sent to this queue in several messages, each of which one
machine renders. Nothing is sent while the site's reducer, which adds up the sums, is away; batches left in the queue are
withdrawn once no worker serves it.
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
from service.scheduling.dispatching.batch_groups import BatchGroup
from service.scheduling.dispatching.dispatcher import Dispatcher
from service.scheduling.dispatching.leases import Lease, Leases
from service.scheduling.dispatching.pacing import MAX_JOINT_BATCHES, BatchSizing
from service.scheduling.fleet.needs import Needs
from service.scheduling.fleet.workers import Workers
from service.scheduling.jobs.active_job import ActiveJob

__all__ = ["ReadySite", "Sites"]

log = logging.getLogger(__name__)


@dataclass
class ReadySite:
    """A site with ready workers of one kind. room: for how many more slots it accepts batches."""

    name: str
    queue: str
    slots: int
    room: int

    def split_for_machines(self, group: BatchGroup, hold_s: float) -> list[BatchGroup]:
        """Divides a group of joint batches into messages of about equal size for the site's machines.

        hold_s: how long, in seconds, sums may wait at the site for the others. Groups that are not joint are returned
        unchanged.
        """
        if not group.is_joint:
            return [group]
        batches = group.batches
        self.room -= len(batches)
        run = Run(self.name, batches[0].first, sum(batch.count for batch in batches), hold_s)
        messages = -(-len(batches) // MAX_JOINT_BATCHES)
        ends = [len(batches) * i // messages for i in range(messages + 1)]
        return [BatchGroup(batches[begin:end], True, run, self.queue) for begin, end in pairwise(ends)]


class Sites:
    """The sites that accept batches at present. Used only by the engine's thread."""

    def __init__(self, workers: Workers, leases: Leases, dispatcher: Dispatcher, pace: BatchSizing) -> None:
        self._workers = workers
        self._leases = leases
        self._dispatcher = dispatcher
        self._pace = pace

    def site_requirements(self) -> list[Needs]:
        """Returns, for each site with a reducer, the site's tag as a requirement.

        The workers of the site serve the queue of jobs with this requirement.
        """
        return [Needs((f"{SITE}{name}",)) for name in self._workers.roster.sites]

    def ready_sites(self, kind: str, per_slot: int) -> list[ReadySite]:
        """Returns the sites that have ready workers of this kind. per_slot: maximum number of outstanding messages per slot."""
        found = []
        for needs in self.site_requirements():
            queue = needs.queue(kind)
            if slots := self._workers.roster.slots_serving(queue, of_cpu=True).get(kind, 0):
                room = self._pace.window(slots, per_slot, joint=True) - self._leases.slots_waiting_in(queue)
                found.append(ReadySite(needs.tags[0].removeprefix(SITE), queue, slots, room))
        return found

    def withdraw_unserved(self, jobs: Mapping[str, ActiveJob]) -> None:
        """Withdraws the batches in queues that no worker serves any more. jobs: active jobs by id. Raises redis.RedisError."""
        elsewhere: defaultdict[str, list[tuple[ActiveJob, Lease]]] = defaultdict(list)
        for lease in self._leases:
            job = jobs.get(lease.owner)
            if (
                job is not None
                and lease.batch is not None
                and not lease.has_arrived
                and lease.queue != job.queue_name(lease.kind)
            ):
                elsewhere[lease.queue].append((job, lease))
        for queue, out in elsewhere.items():
            if self._workers.roster.slots_serving(queue):
                continue
            try:
                taken = self._dispatcher.withdraw(queue, {lease.message for _, lease in out})
            except redis.RedisError as error:
                log.warning("batches for a site stay in its queue: %s", error)
                raise
            for job, lease in out:
                if lease.message in taken and lease.batch is not None and self._leases.end(lease.id) is not None:
                    job.requeue(lease.batch)
