"""Changes to a job: its state, goals (samples, noise or time), frames and queue options."""

from __future__ import annotations

from sqlalchemy.orm import Session

from renderer.sentences import Sentence
from service.access.visit import Visit
from service.clock import deadline_of
from service.errors import Conflict
from service.events import RowWritten
from service.farm import Farm
from service.jobs.change_many import may_begin_anew
from service.jobs.describe import describe, job_out
from service.jobs.frame_changes import carry_out_and_describe
from service.jobs.lookup import job_not_found
from service.jobs.queue import needs_of, reduce_dependencies
from service.jobs.shot_change import ShotChange
from service.models.jobs import JobOut, JobPatch
from service.scheduling.jobs.job_changes import drop_failed_dependencies, set_focus, set_samples, set_state
from service.scheduling.jobs.shot_changes import ShotRequest, samples_of
from service.store.models import FINAL_STATES, Frame, Job, Scene

__all__ = ["change"]

TRIES = 20  # attempts to change a shot despite concurrent changes


def change(id: str, patch: JobPatch, visit: Visit, farm: Farm) -> JobOut:
    """Applies all fields that are set in the patch, or none of them, and returns the changed job.

    Raises NotFound, Conflict, Invalid and OverQuota.
    """
    is_anew = patch.state == "running" and may_begin_anew(id, farm)
    farm.lighting.restore(id)
    request = ShotRequest(**patch.model_dump(include=set(ShotRequest.__dataclass_fields__)))
    for _ in range(TRIES):
        of_shot = ShotChange.from_request(id, request, farm)
        with farm.sessions.begin() as session:
            job = session.get(Job, id, with_for_update=True)
            if job is None:
                raise job_not_found(id)
            if of_shot is not None and not of_shot.is_current(job, session):
                continue  # it was changed concurrently
            is_long = _apply(job, patch, of_shot, is_anew, session, farm, visit)
            # Sums a shot's frames, which takes time if they are many.
            answer = None if job.shot is not None else job_out(job, session, farm.engine)
        break
    else:
        raise Conflict(Sentence("shot-changed-concurrently", "The shot is being changed by others at the same time. Try again."))
    farm.events.publish(RowWritten("job", id))
    if answer is not None:
        return answer
    return carry_out_and_describe(id, farm) if is_long else describe(id, farm)


def _apply(
    job: Job, patch: JobPatch, of_shot: ShotChange | None, is_anew: bool, session: Session, farm: Farm, visit: Visit
) -> bool:
    """Applies a patch inside a transaction. Returns True if changes of frames remain, which need further transactions."""
    is_long = False
    state, samples = job.state, samples_of(job)
    if patch.priority is not None:
        job.priority = patch.priority
    if patch.pinned is not None:
        job.pinned = patch.pinned
    if patch.name is not None:
        job.name = patch.name or _name_of_scene(job, session)
    if patch.note is not None:
        job.note = patch.note or None
    is_more = patch.spp is not None or patch.more is not None or patch.extend is not None or patch.again is not None
    if of_shot is not None:
        if is_more or (state in FINAL_STATES and patch.state == "running"):  # before the job itself counts
            farm.quotas.check_job(visit.caller, session, of_shot.samples, is_new=state in FINAL_STATES)
        is_long = of_shot.store(job, session)
    elif job.shot is None and patch.is_of_frames:
        raise Conflict(Sentence("job-has-no-frames", "The job is a still without frames. Make a new job with frames."))
    elif job.shot is None and (patch.spp is not None or patch.more is not None):
        frame = session.get(Frame, (job.id, 0))
        set_samples(job, patch.spp, patch.more, frame.samples if frame else 0)
    if "focus" in patch.model_fields_set:
        set_focus(job, patch.focus)
    if "max_slots" in patch.model_fields_set:
        job.max_slots = patch.max_slots
    if "deadline" in patch.model_fields_set:
        job.deadline, job.late = None if patch.deadline is None else deadline_of(patch.deadline), None
    if patch.needs is not None:
        job.needs = needs_of(patch.needs)
    if patch.after is not None:
        reduce_dependencies(job.id, patch.after, session)
    if patch.state is not None:
        set_state(job, patch.state, is_anew)
    if of_shot is None and (is_more or (state in FINAL_STATES and job.state not in FINAL_STATES)):
        more = max(0, samples_of(job) - samples)
        with session.no_autoflush:  # unflushed, so the job itself does not count
            farm.quotas.check_job(visit.caller, session, more, is_new=state in FINAL_STATES)
    if patch.state == "running":
        drop_failed_dependencies([job.id], session)
    session.flush()
    return is_long


def _name_of_scene(job: Job, session: Session) -> str:
    scene = session.get(Scene, job.scene)
    return job.name if scene is None else scene.name
