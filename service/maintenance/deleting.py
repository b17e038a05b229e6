"""Deleting jobs: with their pictures, and however many frames they have."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import NamedTuple

from sqlalchemy import delete, func, select
from sqlalchemy.orm import Session

from service.access.quotas import spend
from service.events import Events, RowWritten
from service.store import frame_changes
from service.store.database import Sessions
from service.store.frame_changes import AS_TOLD, AT_A_TIME, FrameChanges, Step
from service.store.garbage import Garbage
from service.store.models import ACTIVE, Frame, Job, blobs_of
from service.store.reserve import Reserve

__all__ = ["Deleted", "Deleting"]


class Deleted(NamedTuple):
    """A job that was there, and how it was."""

    id: str
    state: str
    priority: int


class Deleting:
    """May be used from any thread."""

    def __init__(self, sessions: Sessions, garbage: Garbage, reserve: Reserve, events: Events) -> None:
        self._sessions = sessions
        self._garbage = garbage
        self._reserve = reserve
        self._events = events
        self.frames = FrameChanges(sessions, events, self._forget_one)

    def delete(self, ids: Sequence[str]) -> list[Deleted]:
        """Delete jobs and their pictures; those that are being rendered are stopped. Returns those that were there. Raises
        FarmError; a long shot that is not gone then goes later."""
        long = self._condemn(ids)
        for job in long:
            self._events.publish(RowWritten("job", job))
            self.frames.carry_out_drop(job)
        return [long.get(each.id, each) for each in self._forget(ids)]

    def _condemn(self, ids: Sequence[str]) -> dict[str, Deleted]:
        """Stop those of many frames, which go some at a time: first of all it is written down that they go."""
        with self._sessions() as session:
            counted = select(Frame.job).where(Frame.job.in_(ids)).group_by(Frame.job).having(func.count() > AT_A_TIME)
            many = list(session.scalars(counted))
        found: dict[str, Deleted] = {}

        def write() -> None:
            with self._sessions.begin() as session:
                for job in _rows(many, session):
                    found[job.id] = Deleted(job.id, job.state, job.priority)
                    spend([job], session)
                    if job.state in ACTIVE:
                        job.state, job.finished = "cancelled", time.time()
                    frame_changes.begin(job.id, [Step("drop")], session)

        if many:
            self._reserve.spend_on(write)
        return found

    def _forget_one(self, job: str) -> None:
        self._forget([job])

    def _forget(self, ids: Sequence[str]) -> list[Deleted]:
        deleted: list[Deleted] = []

        def forget(session: Session) -> set[str]:
            deleted.clear()
            jobs = _rows(ids, session)
            spend(jobs, session)
            compiled = session.scalars(select(Frame.compiled).where(Frame.job.in_(ids), Frame.compiled.is_not(None)))
            own = blobs_of([ref for each in compiled if isinstance(each, dict) for ref in each.values() if isinstance(ref, dict)])
            session.execute(delete(Frame).where(Frame.job.in_(ids)), execution_options=AS_TOLD)
            for job in jobs:
                deleted.append(Deleted(job.id, job.state, job.priority))
            session.execute(delete(Job).where(Job.id.in_(ids)), execution_options=AS_TOLD)
            return own

        self._reserve.spend_on(lambda: self._garbage.collect(forget))
        for each in deleted:
            self._events.publish(RowWritten("job", each.id))  # which removes the film, once it is out of its hands
        return deleted


def _rows(ids: Sequence[str], session: Session) -> list[Job]:
    return list(session.scalars(select(Job).where(Job.id.in_(ids)).with_for_update()))
