"""Dependencies of jobs on other jobs.

They are stored only in the database (store/models.py: Wait) and checked about once a second. So it does not matter how the
other jobs end, or whether the service was restarted meanwhile.

Once a predecessor is finished, the dependency is removed, and later changes of the predecessor have no effect. If a predecessor
fails, is cancelled, or is deleted before it was finished, the dependent job fails too, with an error that names the
predecessor. The same applies to the jobs that depend on the failed job.
"""

from __future__ import annotations

import time

from renderer.sentences import Sentence
from service.scheduling.changes import Changes
from service.scheduling.faults.bulkhead import Bulkheads, Step
from service.scheduling.records import Records

__all__ = ["DependencyTracker"]

ALL_WAITING_JOBS = "jobs that wait"
MAX_REVIEW_S = 0.1  # seconds per review, limited for long chains of failing jobs


class DependencyTracker:
    """Tracks the jobs with unfinished dependencies. Used only by the engine's thread."""

    def __init__(self, records: Records, bulkheads: Bulkheads, changes: Changes) -> None:
        self._records = records
        self._bulkheads = bulkheads
        self._changes = changes
        self._held: set[str] = set()

    def set_waiting(self, job: str, waits: bool) -> None:
        """Records whether a job has unfinished dependencies."""
        if waits:
            self._held.add(job)
        else:
            self._held.discard(job)

    def settle_ended(self) -> None:
        """Continues jobs whose dependencies are finished, and fails jobs with a failed predecessor. Called once a second."""
        if self._held:
            self._bulkheads.run(ALL_WAITING_JOBS, Step.CHANGE, self._settle_ended, needs_database=True)

    def _settle_ended(self) -> None:
        until = time.monotonic() + MAX_REVIEW_S
        while (ended := self._records.ended_dependencies()) and self._end_dependencies(ended) and time.monotonic() < until:
            pass  # a job that fails now may have dependents
        for job in self._held - self._records.waiting_jobs():
            self._held.discard(job)
            self._changes.add("job", job)

    def _end_dependencies(self, waits: list[tuple[str, str, str | None, str | None]]) -> bool:
        """Removes dependencies on finished jobs, and fails jobs whose predecessor failed. Returns whether any job failed.

        waits: (job id, predecessor's id, name, state) of each dependency on an ended job; name and state are None if it was
        deleted.
        """
        failed = False
        for job, other, name, state in waits:
            if state == "finished":
                self._records.remove_waits(other)
                continue
            ended = {
                None: Sentence("job-was-deleted", "was deleted"),
                "cancelled": Sentence("job-was-cancelled", "was cancelled"),
            }.get(state, Sentence("job-state-failed", "failed"))
            called = f"{name} ({other})" if name else other
            failed |= self._records.mark_failed(
                job,
                Sentence(
                    "after-job-failed",
                    "It depends on the job {name}, which {state} before it was finished. Set this job to "
                    "running to render it anyway.",
                    name=called,
                    state=ended,
                ),
            )
            self._changes.add("job", job)
        return failed
