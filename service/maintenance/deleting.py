"""Deletes jobs with their films and frames."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import NamedTuple

from sqlalchemy import delete, func, select
from sqlalchemy.orm import Session

from service.access.quotas import record_spent_samples
from service.events import Events, RowWritten
from service.store import frame_changes
from service.store.database import Sessions
from service.store.frame_changes import AT_A_TIME, NO_SYNCHRONIZE, FrameChanges, Step
from service.store.garbage import Garbage
from service.store.models import ACTIVE_STATES, Frame, Job, blobs_of
from service.store.reserve import Reserve

__all__ = ["DeletedJob", "JobDeleter"]


class DeletedJob(NamedTuple):
    """A job that was deleted, with its last state and priority."""

    id: str
    state: str
    priority: int


class JobDeleter:
    """Deletes jobs. Thread-safe."""

    def __init__(self, sessions: Sessions, garbage: Garbage, reserve: Reserve, events: Events) -> None:
        self._sessions = sessions
        self._garbage = garbage
        self._reserve = reserve
        self._events = events
        self.frames = FrameChanges(sessions, events, self._delete_job)

    def delete(self, ids: Sequence[str]) -> list[DeletedJob]:
        """Deletes jobs with their films, and stops those that are being rendered. Returns the jobs that existed.

        The frames of a shot with very many frames may be deleted later, in the background. Raises FarmError.
        """
        long = self._mark_long_shots(ids)
        for job in long:
            self._events.publish(RowWritten("job", job))
            self.frames.drop_frames(job)
        return [long.get(each.id, each) for each in self._delete_jobs(ids)]

    def _mark_long_shots(self, ids: Sequence[str]) -> dict[str, DeletedJob]:
        """Cancels the jobs that have too many frames for one transaction, and marks their frames for deletion in the background.

        Returns these jobs by id.
        """
        with self._sessions() as session:
            counted = select(Frame.job).where(Frame.job.in_(ids)).group_by(Frame.job).having(func.count() > AT_A_TIME)
            many = list(session.scalars(counted))
        found: dict[str, DeletedJob] = {}

        def write() -> None:
            with self._sessions.begin() as session:
                for job in _rows(many, session):
                    found[job.id] = DeletedJob(job.id, job.state, job.priority)
                    record_spent_samples([job], session)
                    if job.state in ACTIVE_STATES:
                        job.state, job.finished = "cancelled", time.time()
                    frame_changes.record_steps(job.id, [Step("drop")], session)

        if many:
            self._reserve.run_deletion(write)
        return found

    def _delete_job(self, job: str) -> None:
        self._delete_jobs([job])

    def _delete_jobs(self, ids: Sequence[str]) -> list[DeletedJob]:
        deleted: list[DeletedJob] = []

        def delete_rows(session: Session) -> set[str]:
            deleted.clear()
            jobs = _rows(ids, session)
            record_spent_samples(jobs, session)
            compiled = session.scalars(select(Frame.compiled).where(Frame.job.in_(ids), Frame.compiled.is_not(None)))
            own = blobs_of([ref for each in compiled if isinstance(each, dict) for ref in each.values() if isinstance(ref, dict)])
            session.execute(delete(Frame).where(Frame.job.in_(ids)), execution_options=NO_SYNCHRONIZE)
            for job in jobs:
                deleted.append(DeletedJob(job.id, job.state, job.priority))
            session.execute(delete(Job).where(Job.id.in_(ids)), execution_options=NO_SYNCHRONIZE)
            return own

        self._reserve.run_deletion(lambda: self._garbage.collect(delete_rows))
        for each in deleted:
            self._events.publish(RowWritten("job", each.id))  # the engine then deletes the film once it is unused
        return deleted


def _rows(ids: Sequence[str], session: Session) -> list[Job]:
    return list(session.scalars(select(Job).where(Job.id.in_(ids)).with_for_update()))
