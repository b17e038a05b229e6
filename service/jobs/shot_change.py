"""Changes of a shot, computed before the database transaction, since a shot may have a hundred thousand frames."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

from sqlalchemy import select
from sqlalchemy.orm import Session

from service.farm import Farm
from service.jobs.lookup import job_not_found
from service.scheduling.jobs.shot_changes import CurrentFrame, ShotRequest, added_samples, change_shot
from service.shot import Shot
from service.store.frame_changes import Step, apply_short_steps, fits_one_transaction, record_steps
from service.store.models import Frame, FrameChange, Job

__all__ = ["ShotChange"]

CHANGED = ("shot", "spp", "noise", "seconds", "state", "finished", "error", "reproduce")


@dataclass(frozen=True)
class ShotChange:
    """A change of a shot, computed but not stored.

    before, after: columns of the job's row. steps: changes of its frames. samples: number of samples that the change adds.
    """

    before: dict[str, Any]
    after: dict[str, Any]
    steps: list[Step]
    samples: int

    @classmethod
    def from_request(cls, id: str, request: ShotRequest, farm: Farm) -> Self | None:
        """Computes the change that a request makes. None for a still image, a request without frame fields, and a missing job.

        Applies pending changes of the job first. Raises Invalid, Conflict, FarmError.
        """
        with farm.sessions() as session:
            job = session.get(Job, id)
            shot = Shot.parse(job.shot) if job is not None else None
            if job is None or shot is None or not request.is_about_frames:
                return None
            session.expunge(job)
        farm.frame_changes.carry_out(id)
        if farm.frame_changes.is_dropped(id):
            raise job_not_found(id)
        with farm.sessions() as session:
            query = select(Frame.number, Frame.spp, Frame.state).where(Frame.job == id).order_by(Frame.number)
            if request.is_about_failures:
                query = query.where(Frame.state == "failed")
            rows = session.execute(query)
            frames = {number: CurrentFrame(spp, state) for number, spp, state in rows}
        before = _columns(job)
        steps = change_shot(job, shot, frames, request)
        return cls(before, _columns(job), steps, added_samples(job, frames, before["spp"], steps))

    def is_current(self, job: Job, session: Session) -> bool:
        """Returns True if the change can still be stored.

        That requires that the job's row is unchanged since the change was computed, and that no other change of its frames is
        pending.
        """
        return _columns(job) == self.before and session.get(FrameChange, job.id) is None

    def store(self, job: Job, session: Session) -> bool:
        """Stores the change inside a transaction. Returns True if changes of frames remain, which need further transactions."""
        for name, value in self.after.items():
            setattr(job, name, value)
        session.flush()
        if fits_one_transaction(self.steps):
            apply_short_steps(job, self.steps, session)
            return False
        record_steps(job.id, self.steps, session)
        return True


def _columns(job: Job) -> dict[str, Any]:
    return {name: getattr(job, name) for name in CHANGED}
