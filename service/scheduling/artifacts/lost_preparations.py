"""Finds preparations of scenes and frames that were lost with their worker."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import cache

from service.scheduling.dispatching.dispatcher import Dispatcher
from service.scheduling.dispatching.leases import MAX_UNSEEN_POLLS, Lease, Leases
from service.scheduling.fleet.workers import Workers
from service.scheduling.incoming.results import Results

__all__ = ["lost_leases"]


def lost_leases(
    leases: Leases, dispatcher: Dispatcher, workers: Workers, results: Results, is_held: Callable[[Lease], bool]
) -> Iterator[tuple[Lease, bool]]:
    """Yields each lease to be ended, and whether its message is still in a queue. Called once a second.

    is_held: returns True if a worker reports the lease's work. A message that only a departed worker may take is withdrawn from
    its queue. A lease whose answer may be among unread results is not lost. Raises redis.RedisError.
    """
    waiting = {id for queue in {lease.queue for lease in leases} for id in dispatcher.waiting_messages(queue)}
    ready = {report.name for report in workers.roster.ready_reports()}
    stream_end = cache(results.latest_position)
    for lease in leases:
        if lease.only and lease.id in waiting and lease.only not in ready:
            dispatcher.withdraw(lease.queue, {lease.id})
            yield lease, True
            continue
        if lease.has_arrived and not lease.is_overdue(time.monotonic()):
            continue
        lease.is_held = is_held(lease)
        lease.record_poll(lease.is_held or lease.id in waiting, stream_end)
        may_be_answered = lease.answered_by is not None and not results.has_read(lease.answered_by)
        if not may_be_answered and (lease.unseen >= MAX_UNSEEN_POLLS or lease.is_overdue(time.monotonic())):
            yield lease, lease.id in waiting
