"""What a job has measured of its scene, so that the page can predict the next picture's time and noise."""

from __future__ import annotations

import math

from renderer import film as film_math
from service.errors import FilmLost, FilmWaits
from service.scheduling.jobs.active_frame import FIRST_LOOK, OF_NOISE
from service.scheduling.jobs.active_job import ActiveJob

__all__ = ["measured"]

LEAST_S = 0.05  # on slots, before they say something of a scene
TILES = 32  # of a frame, evenly over it, whose noise stands for the whole


def measured(job: ActiveJob) -> dict[str, float | None] | None:
    """Of a job at its end: `sample_s`, seconds that a slot takes for a sample of a pixel, and `noise`, the relative standard
    error at one sample a pixel, which falls with their square root (None where there were too few). None where it rendered
    too little.
    """
    if job.rendered_s < LEAST_S:
        return None
    return {"sample_s": job.rendered_s / job.rendered, "noise": _noise(job)}


def _noise(job: ActiveJob) -> float | None:
    frame = next((each for each in job.frames.values() if each.samples and each.state != "failed"), None)
    if frame is None:
        return None
    film = frame.film
    square = area = 0.0
    for tile in range(0, len(film.tiles), math.ceil(len(film.tiles) / TILES)):
        try:
            spp = film.coverage(frame.key, tile).total
            sums = film.tile_planes(frame.key, tile, OF_NOISE)
        except (FilmLost, FilmWaits):  # who needs it later will say so
            return None
        if sums is None or spp < FIRST_LOOK:
            continue
        noise = film_math.noise(sums, film.film_exponent)
        if math.isfinite(noise):
            pixels = film.tiles[tile].w * film.tiles[tile].h
            square += noise**2 * spp * pixels
            area += pixels
    return math.sqrt(square / area) if area else None
