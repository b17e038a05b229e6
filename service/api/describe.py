"""Rows of the database, with what the engine knows in addition, as the API returns them."""

from __future__ import annotations

import logging
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, cast

from sqlalchemy import select
from sqlalchemy.orm import Session

from renderer.errors import SettingsError
from renderer.frames import frame_key, frame_number, frames_text
from renderer.settings import RenderSettings
from service.api.queue_fields import WaitOut, waits_of, waits_sentence, warning_of
from service.api.schemas import (
    BadSampleOut,
    FrameOut,
    FrameState,
    JobOut,
    MeasuredOut,
    SceneOut,
    SceneStatus,
    ShotOut,
    TakenOut,
)
from service.api.worker_fields import worker_out
from service.errors import FarmError
from service.scheduling.active_frame import FrameNumbers
from service.scheduling.engine import Engine
from service.scheduling.needs import Needs
from service.scheduling.snapshot import JobNumbers, Snapshot
from service.scheduling.workers import Roster
from service.shot import Shot
from service.store.models import ACTIVE, Frame, Job, Scene
from worker.protocol.reproduce import sample_command

__all__ = ["UNREADABLE", "frame_out", "frames_out", "job_out", "jobs_out", "scene_out", "snapshot"]

log = logging.getLogger(__name__)

BAD_SHOWN = 16
MOST_NAMED = 500  # jobs in one query
Recorded = list[tuple[int, FrameNumbers]]  # the frames of a job: their keys, and how far they are
_RECORDED = FrameNumbers._fields  # of a frame's row
UNREADABLE = (
    "The record of this {what} cannot be read: it is damaged, or another release of Rayfarm wrote it. "
    "Delete it, or go back to that release."
)


def scene_out(scene: Scene, engine: Engine) -> SceneOut:
    """A scene. One whose row says what this release does not understand is given as far as it is known."""
    try:
        return _scene_out(scene, engine)
    except Exception as error:
        log.warning("scene %s cannot be described: %r", scene.id, error)
        plain = Scene(
            **{name: getattr(scene, name) for name in ("id", "name", "created", "main", "bytes", "project")},
            status="failed",
            error=UNREADABLE.format(what="scene"),
            files=[],
            notes=[],
        )
        return _scene_out(plain, engine)


def job_out(job: Job, session: Session, engine: Engine, view: Snapshot | None = None) -> JobOut:
    """A job, with the engine's latest numbers where it is being rendered. One whose row says what this release does not
    understand is given as far as it is known."""
    return jobs_out([job], session, engine, view)[0]


def jobs_out(jobs: Sequence[Job], session: Session, engine: Engine, view: Snapshot | None = None) -> list[JobOut]:
    """Many jobs, by one look at their frames.

    view: of the engine, from before the rows were read. A job that ends leaves the engine once its numbers are written down:
    whoever looks at the engine last finds them in neither.
    """
    view = view or engine.snapshot
    recorded = _recorded([job.id for job in jobs], session)
    waits = waits_of(jobs, session)
    return [_one_out(job, recorded.get(job.id, []), engine, view, waits.get(job.id, [])) for job in jobs]


def _recorded(jobs: list[str], session: Session) -> dict[str, Recorded]:
    """The frames of jobs as they were last written down, by job."""
    found: dict[str, Recorded] = {}
    columns = [getattr(Frame, name) for name in ("job", "number", *_RECORDED)]
    for at in range(0, len(jobs), MOST_NAMED):
        query = select(*columns).where(Frame.job.in_(jobs[at : at + MOST_NAMED])).order_by(Frame.job, Frame.number)
        for job, number, *numbers in session.execute(query):
            found.setdefault(job, []).append((number, FrameNumbers._make(numbers)))
    return found


def _one_out(job: Job, recorded: Recorded, engine: Engine, view: Snapshot, waits: list[WaitOut]) -> JobOut:
    try:
        out = _job_out(job, recorded, view, waits)
        for frame in out.frames if job.shot is None else ():
            frame.bad = _bad_samples(job, frame, engine)
        return out
    except Exception as error:
        log.warning("job %s cannot be described: %r", job.id, error)
        known = ("id", "scene", "name", "priority", "created", "started", "finished", "active_s", "project", "user")
        plain = Job(
            **{name: getattr(job, name) for name in known}, state="failed", error=UNREADABLE.format(what="job"), request={}
        )
        return _job_out(plain, recorded, view, [])


def _scene_out(scene: Scene, engine: Engine) -> SceneOut:
    info: dict[str, Any] = scene.info or {}
    waits = scene.status == "preparing"
    view = engine.snapshot
    preparing = view.preparing.get(scene.id) if waits else None
    return SceneOut(
        id=scene.id,
        name=scene.name,
        status=cast(SceneStatus, scene.status),
        error=scene.error,
        step=_why_preparing(scene.id, view) if waits else None,
        progress=preparing.fraction if preparing else 0.0 if waits else None,
        created=scene.created,
        main=scene.main,
        files=scene.files,
        bytes=scene.bytes,
        cameras=info.get("cameras", []),
        counts=info.get("counts", {}),
        bounds=info.get("bounds"),
        animations=info.get("animations", []),
        fps=info.get("fps"),
        clips=info.get("clips", []),
        variants=info.get("variants", []),
        variant=scene.variant,
        environment=scene.environment,
        measured=MeasuredOut(**scene.measured) if scene.measured else None,
        warnings=[*scene.notes, *info.get("warnings", [])],
        defaults=info.get("defaults", {}),
        thumbnail=f"/api/scenes/{scene.id}/thumbnail.png" if info.get("thumbnail") else None,
        project=scene.project or "",
    )


def _job_out(job: Job, recorded: Recorded, view: Snapshot, waits: list[WaitOut]) -> JobOut:
    known = view.jobs.get(job.id)
    live = known if job.state in ACTIVE else None
    shot = Shot.of(job.shot)
    about: ShotOut | None = None
    if shot is None:
        frames = _still_frames(job, recorded, known, live is not None)
        sums = _Sums(sum(f.samples for f in frames), sum(f.bad_samples for f in frames), sum(f.progress for f in frames))
    else:
        frames = [_frame_out(job, key, _latest(job, known, key, numbers)) for key, numbers in recorded[:1]]
        sums, about = _shot_out(job, shot, recorded, known)
    size = job.settings or job.request
    return JobOut(
        **{
            name: getattr(job, name)
            for name in (
                *("id", "scene", "name", "state", "error", "reproduce", "priority", "created", "started", "finished"),
                *("spp", "noise", "seconds", "tile_size", "focus", "kind", "settings", "note"),
                *("user", "max_slots", "deadline", "late"),
            )
        },
        project=job.project or "",
        message=_message(job, view, waits) or _holes(job, about),
        after=job.request.get("after") or [],
        waits_for=waits,
        needs=needs.texts if (needs := Needs.of(job.needs)) else [],
        expected=live.expected if live else None,
        unforeseen=live.unforeseen if live else None,
        warning=warning_of(job, live.expected if live else None, time.time()),
        active_s=live.active_s if live else max(job.active_s, known.active_s if known else 0.0),
        progress=live.progress if live and about else sums.progress / max(about.count if about else len(frames), 1),
        eta_s=live.eta_s
        if live and job.state == "running" and not _in_the_way(view.roster)
        else 0.0
        if job.state == "finished"
        else None,
        samples=sums.samples,
        samples_per_s=round(live.samples_per_s, 1) if live else 0.0,
        bad_samples=sums.bad_samples,
        width=size.get("width"),
        height=size.get("height"),
        environment=_light_of(job),
        variant=job.request.get("variant"),
        pinned=bool(job.pinned),
        taken=TakenOut(**job.taken) if job.taken else None,
        doubted=job.doubted or [],
        frames=frames,
        shot=about,
    )


def _light_of(job: Job) -> dict[str, Any] | None:
    """What is asked for of the light from around; None where all of it is the scene's own."""
    found = {name: value for name, value in (job.request.get("environment") or {}).items() if value is not None}
    return {**found, "name": job.light} if "image" in found else found or None


@dataclass(frozen=True)
class _Sums:
    """Over all frames of a job."""

    samples: int
    bad_samples: int
    progress: float


def _still_frames(job: Job, recorded: Recorded, known: JobNumbers | None, is_live: bool) -> list[FrameOut]:
    state = job.state if job.state in ("running", "finished", "failed") else "queued"
    found = []
    for key, f in recorded:
        numbers = FrameNumbers(state, f.samples, f.target, f.bad_samples, f.progress, f.noise, None)
        # The engine writes its numbers down once a second, and once more a moment after a job was cancelled: until then what
        # the database has of a job that is over may be less than what was told of it before.
        if known is not None and (is_live or known.samples > f.samples):
            numbers = numbers._replace(samples=known.samples, bad_samples=known.bad_samples, progress=known.progress)
        found.append(_frame_out(job, key, numbers))
    return found


def frames_out(job: Job, session: Session, engine: Engine, keys: Iterable[int] | None = None) -> list[FrameOut]:
    """The frames of a job, or those of these keys, with the engine's latest numbers."""
    known = engine.snapshot.jobs.get(job.id)
    if job.shot is None:
        return _still_frames(job, _recorded([job.id], session).get(job.id, []), known, job.state in ACTIVE)
    columns = [getattr(Frame, name) for name in ("number", *_RECORDED)]
    query = select(*columns).where(Frame.job == job.id).order_by(Frame.number)
    if keys is not None:
        query = query.where(Frame.number.in_(list(keys)))
    rows = session.execute(query)
    return [_frame_out(job, f.number, _latest(job, known, f.number, FrameNumbers(*f[1:]))) for f in rows]


def _latest(job: Job, known: JobNumbers | None, key: int, recorded: FrameNumbers) -> FrameNumbers:
    """How far a frame of a shot is. For a moment after a job was cancelled the database has less than was told before."""
    live = known.frames.get(key) if known is not None else None
    if live is None or (job.state not in ACTIVE and live.samples <= recorded.samples):
        return recorded
    return live


def frame_out(job: Job, session: Session, engine: Engine, key: int) -> FrameOut | None:
    """One of them, with the first of its bad samples; None where the job has no such frame."""
    found = next((f for f in frames_out(job, session, engine, [key]) if frame_key(f.number) == key), None)
    if found is not None:
        found.bad = _bad_samples(job, found, engine)
    return found


def _frame_out(job: Job, key: int, numbers: FrameNumbers) -> FrameOut:
    size = job.settings or {}
    return FrameOut(
        number=frame_number(key),
        state=cast(FrameState, numbers.state),
        samples=numbers.samples,
        spp=round(numbers.samples / (size.get("width", 1) * size.get("height", 1)), 3),
        bad_samples=numbers.bad_samples,
        bad=[],
        progress=numbers.progress,
        noise=numbers.noise,
        error=numbers.error,
    )


def _shot_out(job: Job, shot: Shot, recorded: Recorded, known: JobNumbers | None) -> tuple[_Sums, ShotOut]:
    if known is not None and job.state in ACTIVE:
        now = [(frame_number(key), known.frames[key]) for key in sorted(known.frames)]
    else:
        now = [(frame_number(key), _latest(job, known, key, numbers)) for key, numbers in recorded]
    noises = [each.noise for _, each in now if each.state != "failed"]
    noise = max((n for n in noises if n is not None), default=None) if None not in noises else None
    about = ShotOut(
        frames=frames_text([number for number, _ in now]),
        count=len(now),
        **{name: getattr(shot, name) for name in ("fps", "clip", "turntable", "order", "every")},
        first=None if shot.first is None else frame_number(shot.first),
        states=cast("dict[FrameState, int]", dict(Counter(each.state for _, each in now))),
        failed=frames_text([number for number, each in now if each.state == "failed"]),
        noise=noise,
        forecast=noise if job.state == "finished" else known.forecast if known is not None else None,
    )
    samples, bad = sum(each.samples for _, each in now), sum(each.bad_samples for _, each in now)
    return _Sums(samples, bad, sum(each.progress for _, each in now)), about


def _bad_samples(job: Job, frame: FrameOut, engine: Engine) -> list[BadSampleOut]:
    if not frame.bad_samples or job.settings is None or job.tile_size is None:
        return []
    try:
        settings = RenderSettings.from_json(job.settings)
        bad = engine.films.open(job.id, settings, job.tile_size).bad_samples(frame_key(frame.number))[1]
    except (FarmError, SettingsError):
        return []  # the job is being deleted, its film is broken or of another release: the job's error says so
    return [BadSampleOut(**b._asdict(), reproduce=sample_command(settings, *b)) for b in bad[:BAD_SHOWN]]


def snapshot(what: str, id: str, session: Session, engine: Engine) -> dict[str, Any] | None:
    """A job, scene or worker as JSON-ready data; None where it is gone."""
    view = engine.snapshot
    if what == "job":
        job = session.get(Job, id)
        return job_out(job, session, engine, view).model_dump() if job else None
    if what == "scene":
        scene = session.get(Scene, id)
        return scene_out(scene, engine).model_dump() if scene else None
    report = view.roster.reports.get(id)
    return worker_out(report, view.roster.orders.get(id), view).model_dump() if report else None


def _message(job: Job, view: Snapshot, waits: list[WaitOut]) -> str | None:
    """Why a job does not go on, where a person may want to know."""
    if job.state == "paused" or job.state not in ACTIVE:
        return None
    if why := waits_sentence(waits):
        return why
    if why := view.fault or view.waits.get(job.id):
        return why
    if job.settings is None:
        return "Waits for its scene to be prepared."
    if why := _in_the_way(view.roster):
        return why
    if job.needs and (why := _unmet(job, view.roster)):
        return why
    if job.lit in view.preparing:
        return "Its scene is prepared under its light."
    if job.shot is not None and view.roster.shooting_kind() is None:
        return "Waits for a worker of this release: those that are connected prepare no frames of shots."
    if job.shot is not None and job.kind is None and job.settings.get("shutter") and view.roster.blurring_kind() is None:
        return "Waits for workers of this release: of those that are connected some blur nothing that moves."
    if job.kind is not None and not view.roster.slots(job.kind):
        return f"Waits for a worker of the kind {job.kind}, with which it began. Start one, or cancel the job and begin anew."
    slots = [slot for slot in view.roster.current() if slot.get("job") == job.id]
    if slots and all(slot.get("compiling") for slot in slots):
        return "The workers compile the kernel for this scene and these settings; the first time that takes a minute or two."
    if (numbers := view.jobs.get(job.id)) is not None and numbers.handed_back is not None:
        return f"{numbers.handed_back.rstrip('.')}. It is tried again."
    if ahead := view.ahead.get(job.id):
        return f"Waits for {ahead} job{'s'[: ahead > 1]} of a higher priority."
    return None


def _unmet(job: Job, roster: Roster) -> str | None:
    """Why no worker that could render a job has what it needs."""
    needs = Needs.of(job.needs)
    able = [report.name for report in roster.ready() if job.kind in (None, report.kind)]
    return needs.lacking(map(roster.offers.get, able)) if needs else None


def _holes(job: Job, shot: ShotOut | None) -> str | None:
    """Which frames a job was finished without."""
    if shot is None or not shot.failed or job.state != "finished":
        return None
    which = f"frame {shot.failed}" if shot.states.get("failed") == 1 else f"the frames {shot.failed[:200]}"
    return f"Finished without {which}. Set the job to running to try again."


def _why_preparing(scene: str, view: Snapshot) -> str:
    """What preparing a scene does or waits for."""
    progress = view.preparing.get(scene)
    return view.waits.get(scene) or (progress.step if progress else _in_the_way(view.roster) or "Waits for a free worker.")


def _in_the_way(roster: Roster) -> str | None:
    """Why nothing at all goes on; None where a worker takes work."""
    if roster.ready():
        return None
    if not roster.reports:
        return "Waits for a worker: none is connected."
    if all(report.state == "paused" or name in roster.orders for name, report in roster.reports.items()):
        rest = any(offer.why for name, offer in roster.offers.items() if name in roster.reports and name not in roster.orders)
        return "Waits: all workers rest or are paused." if rest else "Waits: all workers are paused."
    return "Waits for the workers to load their kernels; the first time that takes half a minute or more."
