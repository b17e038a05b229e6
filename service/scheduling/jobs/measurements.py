"""Measures cost and noise of a job's scene. From these, the page predicts time and noise of the next picture."""

from __future__ import annotations

import math

from renderer import film as film_math
from service.errors import FilmLost, FilmUnavailable
from service.scheduling.jobs.active_frame import FIRST_ESTIMATE_SAMPLES, NOISE_PLANES
from service.scheduling.jobs.active_job import ActiveJob

__all__ = ["Measured", "measured", "updated", "with_denoising"]

LEAST_S = 0.05  # slot-seconds, at least, for a usable measurement
LEAST_ACTIVE_S = 3.0  # minimum duration of a job whose pace is measured; shorter ones spend most of it on starting
BEGIN_S = 0.5  # seconds until the first batch, or until a worker denoises a picture, whatever its size
MOST_PACE = 3.0  # beyond that, the slots have rendered other work in between
LEAST_DENOISED = 100_000  # minimum pixels of a picture whose denoising is measured; smaller ones mostly measure the start
SLOWER_WEIGHT = 1 / 3  # of a slower measurement, in the logarithm
TILES = 32  # evenly spaced tiles of a frame used for its noise


Measured = dict[str, float | None]


def measured(job: ActiveJob, slots: int) -> Measured | None:
    """Returns the measurements of a finished job; None if it rendered too little. slots: number of slots that rendered it.

    `sample_s`: slot-seconds for one sample of a pixel. `noise`: relative standard error at one sample per pixel, which falls with
    the square root of the samples; None if there were too few samples. `pace`: the job's duration, relative to that of its
    batches on all slots: slots also make previews, and wait for batches; None if the job was too short, or if its slots mostly
    rendered something else.
    """
    if job.rendered_s < LEAST_S:
        return None
    pace = None
    if job.active_s >= LEAST_ACTIVE_S and job.rendered == job.samples and slots > 0:
        ratio = (job.active_s - BEGIN_S) * slots / job.rendered_s
        pace = max(ratio, 1.0) if ratio <= MOST_PACE else None
    return {"sample_s": job.rendered_s / job.rendered, "noise": _noise(job), "pace": pace}


def with_denoising(before: Measured | None, seconds: float, pixels: int) -> Measured | None:
    """Returns the measurements of a scene after one of its frames was denoised. None if its rendering was never measured.

    seconds: from the request until the picture was stored. `denoise_s`: the same for a pixel, without BEGIN_S. It is unchanged by
    a picture of fewer than LEAST_DENOISED pixels.
    """
    if not before or pixels < LEAST_DENOISED or seconds <= BEGIN_S:
        return before
    return {**before, "denoise_s": _smoothed(before.get("denoise_s"), (seconds - BEGIN_S) / pixels)}


def updated(before: Measured | None, latest: Measured) -> Measured:
    """Returns the measurements of a scene after another picture. before: the scene's until then; None if it had none.

    A faster `sample_s` or `pace` is adopted, since other work on a machine only slows it down. A slower one counts by a third, in
    the logarithm: it may come from such work, or from settings that cost more.
    """
    old = before or {}
    return {**old, **latest, **{name: _smoothed(old.get(name), latest.get(name)) for name in ("sample_s", "pace")}}


def _smoothed(old: float | None, new: float | None) -> float | None:
    if not old or not new:
        return new or old
    return new if new <= old else old * (new / old) ** SLOWER_WEIGHT


def _noise(job: ActiveJob) -> float | None:
    frame = next((each for each in job.frames.values() if each.samples and each.state != "failed"), None)
    if frame is None:
        return None
    film = frame.film
    square = area = 0.0
    for tile in range(0, len(film.tiles), math.ceil(len(film.tiles) / TILES)):
        try:
            spp = film.coverage(frame.key, tile).total
            sums = film.tile_planes(frame.key, tile, NOISE_PLANES)
        except (FilmLost, FilmUnavailable):  # reported when the film is needed next
            return None
        if sums is None or spp < FIRST_ESTIMATE_SAMPLES:
            continue
        noise = film_math.noise(sums, film.film_exponent)
        if math.isfinite(noise):
            pixels = film.tiles[tile].w * film.tiles[tile].h
            square += noise**2 * spp * pixels
            area += pixels
    return math.sqrt(square / area) if area else None
