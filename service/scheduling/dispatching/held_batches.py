"""The batches that workers currently report: fetched, being rendered, or waiting at a site to be added up."""

from __future__ import annotations

from typing import Any

from service.scheduling.dispatching.leases import Lease
from service.scheduling.fleet.workers import WorkerSnapshot
from service.scheduling.jobs.active_job import ActiveJob

__all__ = ["HeldBatches"]


class HeldBatches:
    """The batches that are reported in one snapshot of the workers' reports."""

    def __init__(self, roster: WorkerSnapshot) -> None:
        self._by_message: dict[Any, str] = {}
        self._by_range: dict[str, str] = {}  # for workers of an older release, which do not report leases
        self._at_work: set[Any] = set()  # leases being rendered
        self._at_sites = {batch for site in roster.sites.values() for batch in site.in_hand}
        for report in roster.reports.values():
            self._by_message.update(dict.fromkeys(report.in_hand, report.name))
            for doing in report.current:
                message = doing.get("message", doing.get("batch"))
                if isinstance(batch := doing.get("batch"), str):
                    self._at_work.add(batch)
                if isinstance(message, str):
                    self._by_message[message] = report.name
                elif "job" in doing:
                    self._by_range[_held_key(*(doing.get(name) for name in ("job", "frame", "tile", "first", "count")))] = (
                        report.name
                    )

    def holder_of(self, lease: Lease, job: ActiveJob) -> str | None:
        """Returns the name of the worker that reports the batch of this lease; None if none does. job: the job of the lease."""
        if lease.batch is None:
            return None
        tile, first, count, frame = lease.batch
        held = self._by_message.get(lease.message)
        if held is not None or not self._by_range:
            return held
        return self._by_range.get(_held_key(job.id, frame, list(job.film.tiles[tile]), first, count))

    def is_rendering(self, lease: Lease) -> bool:
        """Returns True if a slot reports that it is rendering this lease's batch."""
        return lease.id in self._at_work

    def waits_at_site(self, lease: Lease) -> bool:
        """Returns True if a lease's sums have arrived at a site's reducer and wait there for the sums of other batches."""
        return lease.id in self._at_sites


def _held_key(*about: Any) -> str:
    return repr(about)  # always comparable, whatever a report contains
