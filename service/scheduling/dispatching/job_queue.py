"""The jobs that workers of one kind may render, by priority."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping

from service.scheduling.fleet.workers import Workers
from service.scheduling.jobs.active_job import ActiveJob

__all__ = ["JobQueue"]

COUNT_AHEAD_EVERY_S = 1.0


class JobQueue:
    """Orders the active jobs for the scheduler. Used only by the engine's thread."""

    def __init__(self, workers: Workers, jobs: Mapping[str, ActiveJob]) -> None:
        self._workers = workers
        self._jobs = jobs
        self._ahead: tuple[float, dict[str, int]] = (-math.inf, {})  # time and result of the latest count

    def kind_for(self, job: ActiveJob) -> str | None:
        """Returns the worker kind that renders a job: the kind with which it started, else the kind with the most slots.

        Returns None if no ready worker can render it.
        """
        roster = self._workers.roster
        if job.needs is not None and job.kind is None and job.shot is None:
            kinds = {report.kind for report in roster.ready_reports()}
            serving = {kind: roster.slots_serving(job.needs.queue(kind)).get(kind, 0) for kind in sorted(kinds)}
            return max(serving, key=lambda kind: serving[kind], default=None)
        if job.kind is not None or job.shot is None:
            return job.kind or roster.best_kind()
        return roster.open_shutter_kind() if job.settings.shutter else roster.frame_preparing_kind()

    def slots_for(self, job: ActiveJob) -> int:
        """Returns the number of slots that accept batches of this job at present."""
        kind = self.kind_for(job)
        if kind is None:
            return 0
        roster = self._workers.roster
        return roster.slots(kind) if job.needs is None else roster.slots_serving(job.needs.queue(kind)).get(kind, 0)

    def by_priority(self, kind: str) -> dict[int, list[ActiveJob]]:
        """Returns the jobs that workers of this kind may render, by priority."""
        found: dict[int, list[ActiveJob]] = {}
        best = self._workers.roster.best_kind()
        kinds: dict[str, str | None] = {}  # by needs
        for job in self._jobs.values():
            if job.state in ("queued", "running"):
                if job.kind is not None or job.shot is not None:
                    of = self.kind_for(job)
                elif job.needs is None:
                    of = best
                else:
                    if job.needs.text not in kinds:
                        kinds[job.needs.text] = self.kind_for(job)
                    of = kinds[job.needs.text]
                if of == kind:
                    found.setdefault(job.priority, []).append(job)
        return found

    def jobs_ahead(self) -> dict[str, int]:
        """Returns, by job id, the number of unfinished jobs of higher priority that are served before a job.

        Jobs with 0 are omitted. The counts are at most a second old.
        """
        if time.monotonic() - self._ahead[0] > COUNT_AHEAD_EVERY_S:
            self._ahead = time.monotonic(), self._count_ahead()
        return self._ahead[1]

    def _count_ahead(self) -> dict[str, int]:
        found = {}
        for kind in {report.kind for report in self._workers.roster.ready_reports()}:
            before = 0
            for _, equals in sorted(self.by_priority(kind).items(), reverse=True):
                same = [job.id for job in equals if not job.is_done]
                found.update(dict.fromkeys(same, before))
                before += len(same)
        return {id: before for id, before in found.items() if before}
