"""What a person may change in a job, and what that does to its row."""

from __future__ import annotations

import time

from sqlalchemy import delete, select
from sqlalchemy.orm import Session

from renderer.errors import SettingsError
from renderer.settings import MAX_SPP, RenderSettings
from service.errors import Conflict, FilmLost, Invalid
from service.store.film_faults import FILM
from service.store.film_store import FilmStore
from service.store.models import ACTIVE, FINAL, Job, Wait

__all__ = ["ask_for_samples", "begins_anew", "focus_on", "set_state", "wait_no_longer_in_vain"]


def ask_for_samples(job: Job, spp: int | None, more: int | None, has: int) -> None:
    """From now on the job has `spp` samples in every pixel as its aim, or `more` than now. has: the samples in its film.

    A job that was asked for by noise or by time becomes one by samples: its limit was the end of what was asked for first, and
    this is asked for on top. Raises Invalid and Conflict.
    """
    if spp is not None and more is not None:
        raise Invalid("spp: give either spp, for all samples of a pixel, or more, for those on top.")
    is_by_samples = job.noise is None and job.seconds is None
    now = job.spp if is_by_samples else has // _pixels(job)
    if now is None:
        raise Conflict("more: the scene is still being prepared, and how many samples it asks for is not known. Give spp.")
    wanted = now + more if more is not None else spp
    assert wanted is not None
    if wanted > MAX_SPP:
        raise Invalid(f"more: that is {wanted} samples a pixel; at most {MAX_SPP} are rendered.")
    if wanted < now or (wanted == now and not is_by_samples):
        raise Conflict(f"spp: the job has {now} samples a pixel already; samples are added, never taken away.")
    if is_by_samples and wanted == job.spp:
        return
    job.spp, job.noise, job.seconds = wanted, None, None
    if job.state == "finished":
        job.state, job.finished = "queued", None


def set_state(job: Job, state: str, is_anew: bool) -> None:
    """Pause, cancel, or go on; is_anew: with an empty film. Raises Conflict."""
    if state == "cancelled":
        if job.state == "finished":
            raise Conflict("The job is finished; there is nothing to cancel. To remove it, delete it.")
        if job.state != "cancelled":
            job.state, job.finished = "cancelled", time.time()
    elif state == "paused":
        if job.state not in ACTIVE:
            raise Conflict(f"The job is {job.state}; only a queued or running job can be paused.")
        job.state = "paused"
    elif job.state == "paused" or job.state in FINAL:
        job.state, job.finished, job.error, job.reproduce = "queued", None, None, None
        if is_anew:
            job.kind, job.active_s = None, 0.0


def wait_no_longer_in_vain(jobs: list[str], session: Session) -> None:
    """Jobs are to be rendered although something that they were to come after was never finished: that is let go."""
    going_on = select(Job.id).where(Job.state.in_(ACTIVE))
    session.execute(delete(Wait).where(Wait.job.in_(jobs), Wait.other.not_in(going_on)))


def focus_on(job: Job, focus: tuple[int, int, int, int] | None) -> None:
    """Let a rectangle of the picture be rendered first; None: no more. Raises Invalid and Conflict."""
    if focus is not None and job.state in FINAL:
        raise Conflict(f"The job is {job.state}; only of one that is rendered a part can come first.")
    size = {**job.request, **(job.settings or {})}
    width, height = size.get("width"), size.get("height")
    if focus is not None and width and height and (focus[0] >= width or focus[1] >= height):
        raise Invalid(f"focus: {list(focus)} lies beside the picture, which is {width} x {height}.")
    job.focus = None if focus is None else list(focus)


def begins_anew(job: Job, films: FilmStore) -> bool:
    """See to it that a job which is over can go on: what its film has and cannot be read is removed, to be rendered again.

    Returns whether its film is empty then. Reads all of a still's film, since only that shows what is damaged; a shot's, where it
    is known to be: that may take minutes. Raises FilmWaits, and FilmLost where nothing can be done.
    """
    if job.state not in FINAL or job.settings is None or job.tile_size is None:
        return False
    try:
        settings = RenderSettings.from_json(job.settings)
    except SettingsError:
        return False  # which the engine says when it takes the job up
    if job.shot is None or FILM in (job.error or ""):
        films.heal(job.id, settings, job.tile_size)
    try:
        return films.open(job.id, settings, job.tile_size).is_empty
    except FilmLost:
        films.heal(job.id, settings, job.tile_size)
        return films.open(job.id, settings, job.tile_size).is_empty


def _pixels(job: Job) -> int:
    settings = job.settings or {}
    return int(settings.get("width", 1)) * int(settings.get("height", 1))
