"""Dispatching to sites: groups of machines that add up their sums before they send them (protocol/site.py).

A site is efficient for consecutive batches of one tile. It has a queue, that of jobs which require the site's tag (needs.py); its
workers serve this queue in addition to all others. A run of consecutive batches is sent there in as many messages as the site has
machines. Nothing is sent while the site's reducer is away; batches left in its queue are withdrawn once no worker serves it.
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

__all__ = ["SitePlace", "Sites"]

log = logging.getLogger(__name__)


@dataclass
class SitePlace:
    """A site with ready workers of one kind. room: for how many more slots it accepts batches."""

    name: str
    queue: str
    slots: int
    room: int

    def split_for_machines(self, group: BatchGroup, hold_s: float) -> list[BatchGroup]:
        """Divides the joint batches of a tile into messages of about equal size for the site's machines.

        Other groups are unchanged.
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
        """Returns the tags of all sites with a reducer, as requirements; their workers serve the corresponding queues."""
        return [Needs((f"{SITE}{name}",)) for name in self._workers.roster.sites]

    def ready_sites(self, kind: str, per_slot: int) -> list[SitePlace]:
        """Returns the sites that have ready workers of this kind. per_slot: outstanding messages per slot."""
        found = []
        for needs in self.site_requirements():
            queue = needs.queue(kind)
            if slots := self._workers.roster.slots_serving(queue, of_cpu=True).get(kind, 0):
                room = self._pace.window(slots, per_slot, joint=True) - self._leases.slots_waiting_in(queue)
                found.append(SitePlace(needs.tags[0].removeprefix(SITE), queue, slots, room))
        return found

    def withdraw_unserved(self, jobs: Mapping[str, ActiveJob]) -> None:
        """Withdraws the batches in queues that no worker serves any more. Raises redis.RedisError."""
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
