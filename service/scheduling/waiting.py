"""Jobs that depend on others. The dependencies are kept in the database alone (store/models.py: Wait) and checked about once a
second, so it does not matter how the others end, or whether the service was restarted meanwhile.

Once a job's predecessor is finished, the job no longer waits for it, whatever becomes of it later. If a predecessor fails, is
cancelled or is deleted before it was finished, the job fails too, with a sentence that names it; and so do those waiting for
this job.
"""

from __future__ import annotations

import time

from service.scheduling.changes import Changes
from service.scheduling.faults.bulkhead import Bulkheads, Step
from service.scheduling.records import Records

__all__ = ["Waiting"]

ALL = "jobs that wait"
REVIEW_S = 0.1  # of the engine's second, for a long chain that falls: then others have their turn


class Waiting:
    """Lives in the engine's thread."""

    def __init__(self, records: Records, bulkheads: Bulkheads, changes: Changes) -> None:
        self._records = records
        self._bulkheads = bulkheads
        self._changes = changes
        self._held: set[str] = set()

    def note(self, job: str, waits: bool) -> None:
        """Record whether a job waits for others. One that does is noted as changed once it may begin."""
        if waits:
            self._held.add(job)
        else:
            self._held.discard(job)

    def review(self) -> None:
        """Once a second: let those go on that have nothing more to wait for, and fail those that wait in vain."""
        if self._held:
            self._bulkheads.run(ALL, Step.CHANGE, self._review, needs_database=True)

    def _review(self) -> None:
        until = time.monotonic() + REVIEW_S
        while (ended := self._records.ended_waits()) and self._end(ended) and time.monotonic() < until:
            pass  # what fails now may have others behind it
        for job in self._held - self._records.all_waiting():
            self._held.discard(job)
            self._changes.note("job", job)

    def _end(self, waits: list[tuple[str, str, str | None, str | None]]) -> bool:
        """Let go on, or fail, who waits for what is over; whether any failed."""
        failed = False
        for job, other, name, state in waits:
            if state == "finished":
                self._records.waited(other)
                continue
            ended = {None: "was deleted", "cancelled": "was cancelled"}.get(state, "failed")
            called = f"{name} ({other})" if name else other
            failed |= self._records.failed(
                job,
                f"It was to come after the job {called}, which {ended} before it was finished. "
                "Setting this job to running renders it all the same.",
            )
            self._changes.note("job", job)
        return failed
