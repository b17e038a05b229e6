"""Lookup of database rows by the ids in paths."""

from __future__ import annotations

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from renderer.frames import frame_key, frame_text
from renderer.sentences import Sentence
from renderer.settings import Tile
from service.access.projects import Kind
from service.errors import Conflict, Invalid, NotFound
from service.farm import Farm
from service.store.films import Film
from service.store.models import FINAL_STATES, Frame, Job, Scene

__all__ = [
    "environment_not_found",
    "film_of",
    "find_film",
    "find_job",
    "find_picture",
    "find_scene",
    "frame_not_found",
    "is_derived_scene",
    "job_not_found",
    "names_of_ids",
    "no_scene",
    "reference_not_found",
    "resource_not_found",
    "tile_at",
    "without_samples",
]


def find_job(id: str, farm: Farm) -> Job:
    """Returns the job's row. Raises NotFound."""
    with farm.sessions() as session:
        job = session.get(Job, id)
    if job is None:
        raise job_not_found(id)
    return job


def find_scene(id: str, farm: Farm) -> Scene:
    """Returns the scene's row. Raises NotFound."""
    with farm.sessions() as session:
        scene = session.get(Scene, id)
    if scene is None or scene.of is not None:
        raise no_scene(id)
    return scene


def is_derived_scene(id: str, session: Session) -> bool:
    """Returns True if a scene was derived from an uploaded one, by other lighting, material variant, up axis or floor."""
    scene = session.get(Scene, id)
    return scene is not None and scene.of is not None


def find_film(id: str, n: float, farm: Farm) -> Film:
    """Returns the film of a job, after checking that the job has a frame number `n`.

    Raises NotFound, Conflict if there is no film yet, FilmLost if it is lost, FilmUnavailable if it cannot be read yet.
    """
    job = find_job(id, farm)
    if not farm.records.has_frame(id, frame_key(n)):
        raise frame_not_found(n)
    return film_of(job, farm, frame_key(n))


def film_of(job: Job, farm: Farm, key: int = 0) -> Film:
    """Returns the film of a job. Raises Conflict if there is none yet, and as `Farm.film` does. key: the frame's."""
    film = farm.film(job, key)
    if film is None:
        why = job.error or Sentence("picture-scene-preparing", "its scene is still being prepared.")
        raise Conflict(Sentence("job-without-picture", "The job has no picture yet: {error}", error=why))
    return film


def tile_at(film: Film, x: int, y: int) -> tuple[int, Tile]:
    """Returns the index and rectangle of the tile that contains a pixel. Raises Invalid if the pixel is outside the frame."""
    if x >= film.width or y >= film.height:
        raise Invalid(
            Sentence(
                "pixel-not-in-frame",
                "There is no pixel {x}, {y}: the frame is {width} x {height}, counted from 0.",
                x=x,
                y=y,
                width=film.width,
                height=film.height,
            )
        )
    return next((i, t) for i, t in enumerate(film.tiles) if t.x <= x < t.x + t.w and t.y <= y < t.y + t.h)


def find_picture(id: str, n: float, farm: Farm) -> Film:
    """Returns the film of a frame that has samples. Raises Conflict if the frame has none, and as `find_film` does."""
    film = find_film(id, n, farm)
    if not film.samples(frame_key(n)):
        raise without_samples(find_job(id, farm), farm, n)
    return film


def without_samples(job: Job, farm: Farm, n: float | None = None) -> Conflict:
    """Returns the error that explains why frame n has no samples in the film. n: None for all frames."""
    frames = select(func.max(Frame.samples), func.max(Frame.error)).where(Frame.job == job.id)
    with farm.sessions() as session:
        recorded, error = session.execute(frames if n is None else frames.where(Frame.number == frame_key(n))).one()
    if n is not None and error:
        return Conflict(Sentence("frame-without-picture", "The frame has no picture. {error}", error=error))
    if job.state == "finished" or (job.state in FINAL_STATES and recorded):
        return Conflict(Sentence("job-film-gone", "The film of this job is missing. Set the job to running to render it again."))
    if job.state in FINAL_STATES:
        why = job.error or Sentence("picture-job-cancelled", "It was cancelled before.")
        return Conflict(
            Sentence("job-ended-without-picture", "The job ended without a picture. {reason}.", reason=why.rstrip("."))
        )
    return Conflict(
        Sentence("picture-without-samples", "The picture has no samples yet. Try again when its first tiles are rendered.")
    )


def job_not_found(id: str) -> NotFound:
    """Returns the error for a missing job."""
    return NotFound(
        Sentence("job-not-found", "There is no job {id}. GET /api/jobs lists those that are there.", id=repr(id[:60]))
    )


def frame_not_found(frame: float) -> NotFound:
    """Returns the error for a missing frame."""
    return NotFound(
        Sentence(
            "job-frame-not-found",
            "The job has no frame {frame}. GET /api/jobs/{id}/frames lists its frames.",
            frame=frame_text(frame),
        )
    )


def no_scene(id: str) -> NotFound:
    """Returns the error for a missing scene."""
    return NotFound(
        Sentence("scene-not-found", "There is no scene {id}. GET /api/scenes lists those that are there.", id=repr(id[:60]))
    )


def environment_not_found(id: str) -> NotFound:
    """Returns the error for a missing environment."""
    return NotFound(
        Sentence(
            "environment-not-found",
            "There is no environment {id}. GET /api/environments lists those that are there.",
            id=repr(id[:60]),
        )
    )


def reference_not_found(id: str) -> NotFound:
    """Returns the error for a missing reference picture."""
    return NotFound(
        Sentence(
            "reference-not-found",
            "There is no reference picture {id}. GET /api/references lists those that are there.",
            id=repr(id[:60]),
        )
    )


def resource_not_found(kind: Kind, id: str) -> NotFound:
    """Returns the error for an object that is missing or hidden from the caller. The message is the same for both."""
    return {"job": job_not_found, "scene": no_scene, "environment": environment_not_found, "reference": reference_not_found}[
        kind
    ](id)


def names_of_ids(id: str, farm: Farm) -> dict[str, list[str]]:
    """Returns the names of the objects and materials of a job's scene, as lists indexed by their numbers."""
    with farm.sessions() as session:
        scene = session.get(Scene, find_job(id, farm).scene)
    names = ((scene.info if scene else None) or {}).get("names")
    return names or {}
