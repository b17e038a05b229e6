"""Measures cost and noise of a job's scene. From these, the page predicts time and noise of the next picture."""

from __future__ import annotations

import math

from renderer import film as film_math
from service.errors import FilmLost, FilmUnavailable
from service.scheduling.jobs.active_frame import FIRST_ESTIMATE_SAMPLES, NOISE_PLANES
from service.scheduling.jobs.active_job import ActiveJob

__all__ = ["measured", "updated"]

LEAST_S = 0.05  # slot-seconds, at least, for a usable measurement
SLOWER_WEIGHT = 1 / 3  # of a slower measurement, in the logarithm
TILES = 32  # evenly spaced tiles of a frame used for its noise


def measured(job: ActiveJob) -> dict[str, float | None] | None:
    """Returns the measurements of a finished job; None if it rendered too little.

    `sample_s`: slot-seconds for one sample of a pixel. `noise`: relative standard error at one sample per pixel, which falls with
    the square root of the samples; None if there were too few samples.
    """
    if job.rendered_s < LEAST_S:
        return None
    return {"sample_s": job.rendered_s / job.rendered, "noise": _noise(job)}


def updated(before: dict[str, float | None] | None, latest: dict[str, float | None]) -> dict[str, float | None]:
    """Returns the measurements of a scene after another picture. before: the scene's until then; None if it had none.

    A faster `sample_s` is adopted, since other work on a machine only slows it down. A slower one counts by a third, in the
    logarithm: it may come from such work, or from settings that cost more.
    """
    old, new = (before or {}).get("sample_s"), latest["sample_s"]
    if not old or not new or new <= old:
        return latest
    return {**latest, "sample_s": old * (new / old) ** SLOWER_WEIGHT}


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
