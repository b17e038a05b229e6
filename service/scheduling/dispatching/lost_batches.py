"""Detects lost and late batches.

A batch is lost if its worker has died, if several successive polls found it nowhere although all results were read, or if it
takes far too long. An overloaded machine is different: its reports are late or missing for a while, and messages wait long in
the queue or the stream. Treating that as a loss would render everything again and increase the overload. So a worker that has
stopped reporting but is still connected (protocol/lifeline.py) is "away": other workers get its share of new work, and its
batches are duplicated, like those of stragglers, once other slots are idle.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Mapping
from enum import Enum
from functools import cache
from typing import Protocol

from service.clock import Clock
from service.scheduling.dispatching.held_batches import HeldBatches
from service.scheduling.dispatching.leases import MAX_UNSEEN_POLLS, Lease, Leases
from service.scheduling.fleet.workers import WorkerSnapshot
from service.scheduling.incoming.results import Position
from service.scheduling.jobs.active_job import ActiveJob

__all__ = ["Fleet", "LossVerdict", "LostLeaseFinder", "Queues", "ResultStream"]

STRAGGLER_S = 3.0


class LossVerdict(Enum):
    """The reason why a batch is considered lost or late. The values appear in logs."""

    DEAD = "its worker is gone"
    OVERDUE = "it took too long"
    UNSEEN = "nobody has it"
    LATE = "late"

    @property
    def counts_as_loss(self) -> bool:
        """Returns True if the batch itself may have caused its loss."""
        return self in (LossVerdict.DEAD, LossVerdict.OVERDUE)


class Queues(Protocol):
    """Interface of the queues, with the messages that no worker has fetched yet."""

    def waiting_messages(self, queue: str) -> Collection[str]:
        """Returns the ids of the messages that wait in a queue. Raises redis.RedisError."""


class Fleet(Protocol):
    """Interface of the workers' reports."""

    @property
    def roster(self) -> WorkerSnapshot:
        """The latest reports of all workers."""

    def silent_workers(self) -> set[str]:
        """Returns the names of workers that are connected but do not report. Raises redis.RedisError."""

    def has_late_report(self) -> bool:
        """Returns True if the report of any worker is overdue."""


class ResultStream(Protocol):
    """Interface of the stream of results."""

    def latest_position(self) -> Position:
        """Returns the position of the stream's last result. Raises redis.RedisError."""

    def has_read(self, position: Position) -> bool:
        """Returns True if all results up to this position were read."""


class LostLeaseFinder:
    """Finds lost and late leases in regular polls. Used only by the engine's thread."""

    def __init__(self, leases: Leases, workers: Fleet, queues: Queues, clock: Clock = time) -> None:
        self._leases = leases
        self._workers = workers
        self._queues = queues
        self._clock = clock

    def find_lost(
        self, jobs: Mapping[str, ActiveJob], results: ResultStream, transit_s: float = 0.0
    ) -> Iterator[tuple[Lease, LossVerdict]]:
        """Polls queues and workers, and yields the lost and late leases with the reasons. Raises redis.RedisError.

        A lease whose answer may be among unread results is not lost. transit_s: transit time of results in seconds; a message
        to a worker takes about as long, and is not reported by any worker in the meantime.
        """
        max_unseen = MAX_UNSEEN_POLLS + transit_s
        waiting = {id for queue in {lease.queue for lease in self._leases} for id in self._queues.waiting_messages(queue)}
        roster = self._workers.roster
        held = HeldBatches(roster)
        living = self._workers.silent_workers()
        end, is_late = cache(results.latest_position), cache(lambda: bool(living) or self._workers.has_late_report())
        out = [lease for lease in self._leases if lease.batch is not None and not lease.has_arrived and lease.owner in jobs]
        now = self._clock.monotonic()
        for lease in out:
            holder = held.holder_of(lease, jobs[lease.owner])
            is_at_site, waits = held.waits_at_site(lease), lease.message in waiting
            lease.record_poll(holder is not None or is_at_site or waits, end, max_unseen)
            lease.waited = now if waits else lease.waited
            lease.holder = holder or lease.holder
            lease.held_since = lease.held_since or (now if holder else None)
            lease.is_held = holder is not None
        for lease in out:
            is_gone = lease.unseen > 0 and lease.holder is not None and lease.holder not in roster.reports
            is_at_work = held.is_rendering(lease)
            lease.has_begun |= is_at_work
            waits_here = lease.has_begun and lease.is_held and not is_at_work
            is_rendered = lease.is_joint and (waits_here or held.waits_at_site(lease))
            self._leases.update_state(lease, is_gone and lease.holder in living, is_rendered)
            fate = self._verdict(lease, is_gone, is_late, max_unseen)
            may_be_answered = lease.answered_by is not None and not results.has_read(lease.answered_by)
            if fate is LossVerdict.LATE or (fate is not None and lease.message not in waiting and not may_be_answered):
                yield lease, fate

    def _verdict(self, lease: Lease, is_gone: bool, is_late: Callable[[], bool], max_unseen: float) -> LossVerdict | None:
        """Returns why a lease is lost or late; None if it is neither.

        is_gone: whether its worker does not report. is_late: returns whether the report of some worker is overdue, which may
        therefore have the lease. max_unseen: number of successive polls without the lease after which it is lost.
        """
        if lease.is_away:
            return None if lease.doubled else LossVerdict.LATE
        if is_gone:
            return LossVerdict.DEAD
        if lease.is_overdue(self._clock.monotonic()) and (lease.is_held or not is_late()):
            return LossVerdict.OVERDUE
        if lease.unseen >= max_unseen and not is_late():
            return LossVerdict.UNSEEN
        since = lease.held_since or lease.issued
        is_straggler = lease.is_held and self._clock.monotonic() - since > max(
            STRAGGLER_S, 6 * lease.expected_s, 2 * lease.message_s
        )
        return LossVerdict.LATE if is_straggler and not lease.doubled else None
