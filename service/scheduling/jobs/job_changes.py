"""Changes of a job that a user requests, applied to the job's database row."""

from __future__ import annotations

import time

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from renderer.errors import SettingsError
from renderer.sentences import Sentence
from renderer.settings import RenderSettings
from service.errors import Conflict, FilmLost, Invalid
from service.scheduling.jobs.shot_changes import check_one_goal, requested_spp
from service.store.film_faults import FILM
from service.store.film_store import FilmStore
from service.store.models import ACTIVE_STATES, FINAL_STATES, STATE_LABELS, Job, Wait

__all__ = ["begins_anew", "drop_failed_dependencies", "set_focus", "set_samples", "set_state"]


def set_samples(job: Job, spp: int | None, added: int | None, present: int) -> None:
    """Sets a job's goal: `spp` samples per pixel in total, or `added` samples per pixel more than at present.

    Replaces a goal by noise or time. present: number of samples in the film, over all pixels. Raises Invalid and Conflict.
    """
    check_one_goal(spp, added)
    is_by_samples = job.noise is None and job.seconds is None
    now = job.spp if is_by_samples else present // _pixels(job)
    if now is None:
        raise Conflict(
            Sentence(
                "more-scene-preparing",
                "more: the scene is still being prepared, so its number of samples is not known. Give spp.",
            )
        )
    wanted = requested_spp(now, spp, added)
    if wanted < now or (wanted == now and not is_by_samples):
        raise Conflict(
            Sentence("job-spp-lowered", "spp: the job has {spp} samples per pixel already; samples can only be added.", spp=now)
        )
    if is_by_samples and wanted == job.spp:
        return
    job.spp, job.noise, job.seconds = wanted, None, None
    if job.state == "finished":
        job.state, job.finished = "queued", None


def set_state(job: Job, state: str, is_anew: bool) -> None:
    """Pauses, cancels or resumes a job. is_anew: whether a resumed job starts with an empty film. Raises Conflict."""
    if state == "cancelled":
        if job.state == "finished":
            raise Conflict(
                Sentence("job-already-finished", "The job is finished; there is nothing to cancel. To remove it, delete it.")
            )
        if job.state != "cancelled":
            job.state, job.finished = "cancelled", time.time()
    elif state == "paused":
        if job.state not in ACTIVE_STATES:
            raise Conflict(
                Sentence(
                    "job-not-pausable",
                    "The job is {state}; only a queued or running job can be paused.",
                    state=STATE_LABELS[job.state],
                )
            )
        job.state = "paused"
    elif job.state == "paused" or job.state in FINAL_STATES:
        job.state, job.finished, job.error, job.reproduce = "queued", None, None, None
        if is_anew:
            job.kind, job.active_s = None, 0.0


def drop_failed_dependencies(jobs: list[str], session: Session) -> None:
    """Removes dependencies of these jobs on jobs that failed, were cancelled or were deleted."""
    active = select(Job.id).where(Job.state.in_(ACTIVE_STATES))
    session.execute(delete(Wait).where(Wait.job.in_(jobs), Wait.other.not_in(active)))


def set_focus(job: Job, focus: tuple[int, int, int, int] | None) -> None:
    """Sets the rectangle of the picture (x0, y0, x1, y1, in pixels) that is rendered first; None removes it.

    Raises Invalid and Conflict.
    """
    if focus is not None and job.state in FINAL_STATES:
        raise Conflict(
            Sentence(
                "job-focus-not-rendering",
                "The job is {state}; a part can only be rendered first while a job is rendered.",
                state=STATE_LABELS[job.state],
            )
        )
    size = {**job.request, **(job.settings or {})}
    width, height = size.get("width"), size.get("height")
    if focus is not None and width and height and (focus[0] >= width or focus[1] >= height):
        raise Invalid(
            Sentence(
                "job-focus-outside-picture",
                "focus: {focus} is outside the picture, which is {width} x {height}.",
                focus=list(focus),
                width=width,
                height=height,
            )
        )
    job.focus = None if focus is None else list(focus)


def begins_anew(job: Job, films: FilmStore) -> bool:
    """Removes unreadable data from the film of an ended job. Returns True if the film is empty afterwards.

    Reads the whole film of a still image, since it may have undetected damage. Reads a shot's film, which may take minutes,
    only if it is known to be damaged. Raises FilmUnavailable and FilmLost.
    """
    if job.state not in FINAL_STATES or job.settings is None or job.tile_size is None:
        return False
    try:
        settings = RenderSettings.from_json(job.settings)
    except SettingsError:
        return False  # the engine reports it when it loads the job
    if job.shot is None or FILM in (job.error or ""):
        films.delete_damaged(job.id, settings, job.tile_size)
    try:
        return films.open(job.id, settings, job.tile_size).is_empty
    except FilmLost:
        films.delete_damaged(job.id, settings, job.tile_size)
        return films.open(job.id, settings, job.tile_size).is_empty


def _pixels(job: Job) -> int:
    settings = job.settings or {}
    return int(settings.get("width", 1)) * int(settings.get("height", 1))
