"""Rows of the database, and what the engine knows on top of them, as the API gives them."""

from __future__ import annotations

import logging
from dataclasses import asdict
from typing import Any, cast

from sqlalchemy import select
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from renderer.errors import SettingsError
from renderer.settings import RenderSettings
from service.api.schemas import BadSampleOut, FrameOut, JobOut, SceneOut, SceneStatus, WorkerOut
from service.errors import FarmError
from service.scheduling.engine import Engine
from service.scheduling.snapshot import Snapshot
from service.scheduling.workers import Roster
from service.store.models import ACTIVE, Frame, Job, Scene
from worker.contract import WorkerReport
from worker.reproduce import sample_command

__all__ = ["UNREADABLE", "job_out", "scene_out", "snapshot", "worker_out"]

log = logging.getLogger(__name__)

BAD_SHOWN = 16
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
            **{name: getattr(scene, name) for name in ("id", "name", "created", "main", "bytes")},
            status="failed",
            error=UNREADABLE.format(what="scene"),
            files=[],
            notes=[],
        )
        return _scene_out(plain, engine)


def job_out(job: Job, session: Session, engine: Engine) -> JobOut:
    """A job, with the engine's latest numbers where it is being rendered. One whose row says what this release does not
    understand is given as far as it is known."""
    try:
        return _job_out(job, session, engine)
    except SQLAlchemyError:
        raise
    except Exception as error:
        log.warning("job %s cannot be described: %r", job.id, error)
        known = ("id", "scene", "name", "priority", "created", "started", "finished", "active_s")
        plain = Job(
            **{name: getattr(job, name) for name in known}, state="failed", error=UNREADABLE.format(what="job"), request={}
        )
        return _job_out(plain, session, engine)


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
        variants=info.get("variants", []),
        variant=scene.variant,
        environment=scene.environment,
        warnings=[*scene.notes, *info.get("warnings", [])],
        defaults=info.get("defaults", {}),
        thumbnail=f"/api/scenes/{scene.id}/thumbnail.png" if info.get("thumbnail") else None,
    )


def _job_out(job: Job, session: Session, engine: Engine) -> JobOut:
    known = engine.snapshot.jobs.get(job.id)
    live = known if job.state in ACTIVE else None
    frames = [
        FrameOut(number=f.number, samples=f.samples, bad_samples=f.bad_samples, bad=[], progress=f.progress)
        for f in session.scalars(select(Frame).where(Frame.job == job.id).order_by(Frame.number))
    ]
    if known is not None:
        # The engine writes its numbers down once a second, and once more a moment after a job was cancelled: until then what
        # the database has of a job that is over may be less than what was told of it before.
        numbers = {"samples": known.samples, "bad_samples": known.bad_samples, "progress": known.progress}
        is_newer = [f.number == known.frame and (live is not None or known.samples > f.samples) for f in frames]
        frames = [f.model_copy(update=numbers) if newer else f for f, newer in zip(frames, is_newer, strict=True)]
    for f in frames:
        f.bad = _bad_samples(job, f, engine)
    size = job.settings or job.request
    return JobOut(
        **{
            name: getattr(job, name)
            for name in (
                *("id", "scene", "name", "state", "error", "reproduce", "priority", "created", "started", "finished"),
                *("spp", "noise", "seconds", "tile_size", "kind", "settings"),
            )
        },
        message=_message(job, engine.snapshot),
        active_s=live.active_s if live else max(job.active_s, known.active_s if known else 0.0),
        progress=sum(f.progress for f in frames) / max(len(frames), 1),
        eta_s=live.eta_s if live and job.state == "running" else 0.0 if job.state == "finished" else None,
        samples=sum(f.samples for f in frames),
        samples_per_s=live.samples_per_s if live else 0.0,
        bad_samples=sum(f.bad_samples for f in frames),
        width=size.get("width"),
        height=size.get("height"),
        frames=frames,
    )


def _bad_samples(job: Job, frame: FrameOut, engine: Engine) -> list[BadSampleOut]:
    if not frame.bad_samples or job.settings is None or job.tile_size is None:
        return []
    try:
        settings = RenderSettings.from_json(job.settings)
        bad = engine.films.open(job.id, settings, job.tile_size).bad_samples(frame.number)[1]
    except (FarmError, SettingsError):
        return []  # the job is being deleted, its film is broken or of another release: the job's error says so
    return [BadSampleOut(**b._asdict(), reproduce=sample_command(settings, *b)) for b in bad[:BAD_SHOWN]]


def worker_out(report: WorkerReport, why: str | None) -> WorkerOut:
    """A worker. One that is told to pause (why) counts as paused, though it may still finish what it has in hand."""
    return WorkerOut(**{**asdict(report), "state": report.state if why is None else "paused"}, message=why)


def snapshot(what: str, id: str, session: Session, engine: Engine) -> dict[str, Any] | None:
    """A job, scene or worker as JSON-ready data; None where it is gone."""
    if what == "job":
        job = session.get(Job, id)
        return job_out(job, session, engine).model_dump() if job else None
    if what == "scene":
        scene = session.get(Scene, id)
        return scene_out(scene, engine).model_dump() if scene else None
    roster = engine.snapshot.roster
    report = roster.reports.get(id)
    return worker_out(report, roster.orders.get(id)).model_dump() if report else None


def _message(job: Job, view: Snapshot) -> str | None:
    """Why a job does not go on, where a person may want to know."""
    if job.state == "paused" or job.state not in ACTIVE:
        return None
    if why := view.fault or view.waits.get(job.id):
        return why
    if job.settings is None:
        return "Waits for its scene to be prepared."
    if why := _in_the_way(view.roster):
        return why
    if job.kind is not None and not view.roster.slots(job.kind):
        return f"Waits for a worker of the kind {job.kind}, with which it began. Start one, or cancel the job and begin anew."
    slots = [slot for slot in view.roster.current() if slot.get("job") == job.id]
    if slots and all(slot.get("compiling") for slot in slots):
        return "The workers compile the kernel for this scene and these settings; the first time that takes up to a minute."
    if (numbers := view.jobs.get(job.id)) is not None and numbers.handed_back is not None:
        return f"{numbers.handed_back.rstrip('.')}. It is tried again."
    if ahead := view.ahead.get(job.id):
        return f"Waits for {ahead} job{'s'[: ahead > 1]} of a higher priority."
    return None


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
        return "Waits: all workers are paused."
    return "Waits for the workers to load their kernels; the first time that takes half a minute or more."
