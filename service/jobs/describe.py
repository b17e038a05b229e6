"""Converts jobs from database rows, with the engine's current numbers, to the API's models."""

from __future__ import annotations

import logging
import time
from collections.abc import Sequence
from operator import attrgetter
from typing import Any, NamedTuple, cast

from sqlalchemy import select
from sqlalchemy.orm import Session

from renderer.frames import frame_key, frame_number, frames_text
from renderer.sentences import Sentence
from service.farm import Farm
from service.jobs.describe_frames import RECORDED, Recorded, bad_samples_of, latest_frame_numbers, one_frame, still_numbers
from service.jobs.lookup import find_job
from service.jobs.queue import waits_of, waits_sentence, warning_of
from service.jobs.shot_sums import ShotSums, sums_of
from service.models.jobs import (
    FrameState,
    JobIn,
    JobOut,
    ShotOut,
    TakenOut,
)
from service.models.queue import WaitOut
from service.scheduling.engine import Engine
from service.scheduling.fleet.needs import Needs
from service.scheduling.fleet.workers import WorkerSnapshot
from service.scheduling.jobs.active_frame import FrameNumbers
from service.scheduling.snapshot import JobNumbers, Snapshot
from service.shot import Shot
from service.store.models import ACTIVE_STATES, Frame, Job

__all__ = ["UNREADABLE_JOB", "UNREADABLE_SCENE", "describe", "farm_stall_reason", "job_out", "jobs_out"]

log = logging.getLogger(__name__)

# Columns of a job's row, read by one call in C, since a list has a thousand rows.
_COPIED_COLUMNS = (
    *("id", "scene", "name", "state", "error", "reproduce", "priority", "created", "started", "finished"),
    *("spp", "noise", "seconds", "tile_size", "focus", "kind", "settings", "note", "review"),
    *("user", "max_slots", "deadline", "late"),
)
_copied_values = attrgetter(*_COPIED_COLUMNS)
MAX_NAMED_JOBS = 500  # jobs in one query
UNREADABLE_JOB = Sentence(
    "job-record-unreadable",
    "The record of this job cannot be read: it is damaged, or another release of Rayfarm wrote it. "
    "Delete it, or go back to that release.",
)
UNREADABLE_SCENE = Sentence(
    "scene-record-unreadable",
    "The record of this scene cannot be read: it is damaged, or another release of Rayfarm wrote it. "
    "Delete it, or go back to that release.",
)


def job_out(job: Job, session: Session, engine: Engine, view: Snapshot | None = None) -> JobOut:
    """Returns a job as the API's model, with the engine's latest numbers if it is being rendered.

    A row that this release cannot interpret is described as failed, with the fields that could be read.
    """
    return jobs_out([job], session, engine, view)[0]


def describe(id: str, farm: Farm) -> JobOut:
    """Returns the API's model of the job with this id. Raises NotFound."""
    view = farm.engine.snapshot  # before the row, so that the numbers are not newer than the state
    with farm.sessions() as session:
        return job_out(find_job(id, farm), session, farm.engine, view)


def jobs_out(jobs: Sequence[Job], session: Session, engine: Engine, view: Snapshot | None = None) -> list[JobOut]:
    """Returns jobs as the API's models, with one query for all their frames.

    view: a snapshot of the engine, taken before the rows were read. A job leaves the engine only after its numbers are stored, so
    a snapshot taken later could lack numbers that the rows do not contain yet.
    """
    as_of = time.time()
    view = view or engine.snapshot
    shots = {job.id for job in jobs if job.shot is not None}
    recorded = _stored_frame_numbers([job.id for job in jobs if job.id not in shots], session)
    sums = sums_of([job for job in jobs if job.id in shots], view.jobs, session)
    waits = waits_of(jobs, session)
    found = [
        _one_out(job, recorded.get(job.id, []), sums.get(job.id), session, engine, view, waits.get(job.id, [])) for job in jobs
    ]
    for each in found:
        each.as_of = as_of
    return found


def _stored_frame_numbers(jobs: list[str], session: Session) -> dict[str, Recorded]:
    """Returns the numbers (samples, progress, noise ...) of still images' frames as stored in the database, by job id."""
    found: dict[str, Recorded] = {}
    columns = [getattr(Frame, name) for name in ("job", "number", *RECORDED)]
    for at in range(0, len(jobs), MAX_NAMED_JOBS):
        query = select(*columns).where(Frame.job.in_(jobs[at : at + MAX_NAMED_JOBS])).order_by(Frame.job, Frame.number)
        for job, number, *numbers in session.execute(query):
            found.setdefault(job, []).append((number, FrameNumbers._make(numbers)))
    return found


def _one_out(
    job: Job,
    recorded: Recorded,
    sums: ShotSums | None,
    session: Session,
    engine: Engine,
    view: Snapshot,
    waits: list[WaitOut],
) -> JobOut:
    try:
        out = _job_out(job, recorded, sums, view, waits)
        for frame in out.frames:
            frame.denoised = engine.has_denoised(job.id, frame_key(frame.number), frame.samples)
            if frame.bad_samples and job.shot is None:
                frame.bad = bad_samples_of(job, frame, session, engine)
        if out.denoise and out.state == "finished" and job.shot is None:
            out.elapsed_s += sum(engine.denoising_s(job.id, frame_key(frame.number), frame.samples) for frame in out.frames)
        return out
    except Exception as error:
        log.warning("job %s cannot be described: %r", job.id, error)
        known = ("id", "scene", "name", "priority", "created", "started", "finished", "active_s", "project", "user")
        plain = Job(**{name: getattr(job, name) for name in known}, state="failed", error=UNREADABLE_JOB, request={})
        return _job_out(plain, recorded, None, view, [])


def _job_out(job: Job, recorded: Recorded, of_shot: ShotSums | None, view: Snapshot, waits: list[WaitOut]) -> JobOut:
    known = view.jobs.get(job.id)
    live = known if job.state in ACTIVE_STATES else None
    shot = Shot.parse(job.shot)
    about: ShotOut | None = None
    if shot is None or of_shot is None:
        frames = [one_frame(job, *each) for each in still_numbers(job, recorded, known, live is not None)]
        sums = _Sums(sum(f.samples for f in frames), sum(f.bad_samples for f in frames), sum(f.progress for f in frames))
    else:
        first = of_shot.first
        frames = [] if first is None else [one_frame(job, first[0], latest_frame_numbers(job, known, *first))]
        sums, about = _shot_out(job, shot, of_shot, known)
    size = job.settings or job.request
    active_s = live.active_s if live else max(job.active_s, known.active_s if known else 0.0)
    return JobOut(
        **dict(zip(_COPIED_COLUMNS, _copied_values(job), strict=True)),
        project=job.project or "",
        message=_message(job, view, waits) or _failed_frames_note(job, about),
        stranded=job.state in ("queued", "running") and _is_stranded(job, view.roster) and bool(view.roster.ready_reports()),
        after=job.request.get("after") or [],
        waits_for=waits,
        needs=needs.texts if (needs := Needs.from_json(job.needs)) else [],
        expected=live.expected if live else None,
        unforeseen=live.unforeseen if live else None,
        warning=warning_of(job, live.expected if live else None, time.time()),
        active_s=active_s,
        elapsed_s=active_s,
        progress=live.progress if live and about else sums.progress / max(about.count if about else len(frames), 1),
        eta_s=live.eta_s
        if live and job.state == "running" and not farm_stall_reason(view.roster)
        else 0.0
        if job.state == "finished"
        else None,
        samples=sums.samples,
        samples_per_s=round(live.samples_per_s, 1) if live else 0.0,
        bad_samples=sums.bad_samples,
        width=size.get("width"),
        height=size.get("height"),
        environment=_requested_environment(job),
        variant=job.request.get("variant"),
        up=job.request.get("up"),
        floor=job.request.get("floor"),
        denoise=bool(job.request.get("denoise")),
        exposure=job.request.get("exposure", 0.0),
        tonemap=job.request.get("tonemap", JobIn.model_fields["tonemap"].default),
        pinned=bool(job.pinned),
        taken=TakenOut(**job.taken) if job.taken else None,
        doubted=job.doubted or [],
        frames=frames,
        shot=about,
    )


def _requested_environment(job: Job) -> dict[str, Any] | None:
    """Returns the environment that a job's request sets; None if it uses the scene's own."""
    requested: dict[str, Any] = job.request.get("environment") or {}
    found = {name: value for name, value in requested.items() if value is not None}
    return {**found, "name": job.light} if "image" in found else found or None


class _Sums(NamedTuple):
    """Totals over all frames of a job: samples, discarded samples, and progress."""

    samples: int
    bad_samples: int
    progress: float


def _shot_out(job: Job, shot: Shot, now: ShotSums, live: JobNumbers | None) -> tuple[_Sums, ShotOut]:
    about = ShotOut(
        frames=now.frames,
        count=now.count,
        **{name: getattr(shot, name) for name in ("fps", "clip", "turntable", "order", "every")},
        first=None if shot.first is None else frame_number(shot.first),
        states=cast("dict[FrameState, int]", dict(now.states)),
        failed=frames_text(map(frame_number, now.failed)),
        noise=now.noise,
        forecast=now.noise if job.state == "finished" else live.forecast if live is not None else None,
    )
    return _Sums(now.samples, now.bad_samples, now.progress), about


def _message(job: Job, view: Snapshot, waits: list[WaitOut]) -> str | None:
    """Returns a sentence that explains why an unfinished job makes no progress; None if it does, or is paused or ended."""
    if job.state == "paused" or job.state not in ACTIVE_STATES:
        return None
    if why := waits_sentence(waits):
        return why
    if why := view.fault or view.waits.get(job.id):
        return why
    if job.settings is None:
        return Sentence("job-waits-for-scene", "Waits for its scene to be prepared.")
    if why := farm_stall_reason(view.roster):
        return why
    if job.needs and (why := _unmet_requirements(job, view.roster)):
        return why
    if job.lit in view.preparing:
        return Sentence("job-waits-for-light", "Its scene is being prepared with its light.")
    if job.shot is not None and view.roster.frame_preparing_kind() is None:
        return Sentence(
            "job-waits-for-release", "Waits for a worker of this release: those connected cannot prepare frames of shots."
        )
    if job.shot is not None and job.kind is None and job.settings.get("shutter") and view.roster.open_shutter_kind() is None:
        return Sentence(
            "job-waits-for-motion-blur", "Waits for workers of this release: some of those connected do not support motion blur."
        )
    if _is_stranded(job, view.roster):
        return Sentence(
            "job-waits-for-worker-kind",
            "Waits for a worker of the kind {kind}, on which it was begun. Start one, or cancel the job and start again.",
            kind=job.kind,
        )
    slots = [slot for slot in view.roster.current() if slot.get("job") == job.id]
    if slots and all(slot.get("compiling") for slot in slots):
        return Sentence("kernel-compiling", "Compiling renderer (first time, about half a minute)")
    if (numbers := view.jobs.get(job.id)) is not None and numbers.handed_back is not None:
        return Sentence("job-retried", "{reason}. It will be retried.", reason=numbers.handed_back.rstrip("."))
    if ahead := view.ahead.get(job.id):
        if ahead == 1:
            return Sentence("job-waits-for-priority-one", "Waits for 1 job of a higher priority.")
        return Sentence("job-waits-for-priority", "Waits for {count} jobs of a higher priority.", count=ahead)
    return None


def _is_stranded(job: Job, roster: WorkerSnapshot) -> bool:
    """Returns True if a job was begun by a kind of worker (kernels and processor) of which none is connected now."""
    return job.kind is not None and not roster.slots(job.kind)


def _unmet_requirements(job: Job, roster: WorkerSnapshot) -> str | None:
    """Returns a sentence on why no connected worker meets a job's requirements; None if one does."""
    needs = Needs.from_json(job.needs)
    able = [report.name for report in roster.ready_reports() if job.kind in (None, report.kind)]
    return needs.unmet_reason(map(roster.offers.get, able)) if needs else None


def _failed_frames_note(job: Job, shot: ShotOut | None) -> str | None:
    """Returns a sentence about the frames that failed in a finished shot; None if there are none."""
    if shot is None or not shot.failed or job.state != "finished":
        return None
    which = (
        Sentence("label-frame", "frame {frame}", frame=shot.failed)
        if shot.states.get("failed") == 1
        else Sentence("label-frames", "the frames {frames}", frames=shot.failed[:200])
    )
    return Sentence(
        "job-finished-without-frames", "Finished without {frames}. Set the job to running to try again.", frames=which
    )


def farm_stall_reason(roster: WorkerSnapshot) -> str | None:
    """Returns a sentence on why no worker of the farm accepts work; None if one does."""
    if roster.ready_reports():
        return None
    if not roster.reports:
        return Sentence("job-waits-for-worker", "Waits for a worker: none is connected.")
    if all(report.state == "paused" or name in roster.orders for name, report in roster.reports.items()):
        rest = any(offer.why for name, offer in roster.offers.items() if name in roster.reports and name not in roster.orders)
        return (
            Sentence("job-waits-workers-resting", "Waits: all workers are inactive or paused.")
            if rest
            else Sentence("job-waits-workers-paused", "Waits: all workers are paused.")
        )
    return Sentence("job-waits-for-kernel-load", "Waits for the workers to start.")
