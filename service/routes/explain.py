"""/api/jobs/{id}/explain: explains a pixel's colour; a worker traces the paths of its samples again."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import Query
from pydantic import BaseModel, Field

from protocol.explained import ExplainPixel
from renderer.errors import SettingsError
from renderer.film import COLOR, SAMPLES
from renderer.frames import MAX_FRAME, frame_key
from renderer.sentences import Sentence
from renderer.settings import MAX_SPP
from service.errors import Conflict, Unavailable
from service.events import PreparationRequested
from service.farm import Farm
from service.http.farm import FarmDependency
from service.http.routers import api_router
from service.jobs.frame_scene import frame_scene
from service.jobs.lookup import find_film, find_job, tile_at
from service.store.films import Film
from service.store.models import Frame, Job, Scene
from service.viewing.explaining import unreadable_answer

__all__ = ["router"]

MAX_SAMPLES = 16384  # limit on rendered samples, as in renderer/pixel_paths.py

router = api_router(prefix="/api/jobs", tags=["jobs"])

Numbers = list[float | None]
Spot = Annotated[
    list[float],
    Field(description="x, y, w: seen x / w, y / w pixels from the upper left corner; where w is not above 0, not before the eye"),
]
Choice = Literal["asked", "first", "median", "brightest"]
Ending = Literal["missed", "absorbed", "roulette", "depth", "diffuse", "glossy", "transmission", "caught", "unlit", "passed"]


class LightOut(BaseModel):
    """The point on a light that was chosen at a vertex (next-event estimation)."""

    point: Numbers | None = Field(description="point on the light; null: infinitely far")
    direction: Numbers = Field(description="unit vector from the vertex to the light")
    pdf: float | None = Field(description="probability density of the direction, per steradian")
    weight: float = Field(description="weight of multiple importance sampling against BSDF sampling")
    brought: Numbers = Field(description="radiance that it contributes to the sample if it is not occluded")
    spot: Spot


class PathVertexOut(BaseModel):
    """One vertex of a path: what its ray hit, and the light found. Colours are linear Rec.709; positions in world space."""

    kind: Literal["surface", "passed", "medium", "missed"] = Field(
        description="passed: a surface that is transparent by its alpha, or a lamp without a body; medium: a point in fog, "
        "milk or the like, where it was scattered; missed: the environment"
    )
    object: int | None = Field(description="number of the object; null: none")
    material: int | None = Field(description="number of the material; null: none")
    object_name: str | None = Field(None, description="name of the object; null: none")
    material_name: str | None = Field(None, description="name of the material; null: none")
    model: str | None = Field(description="scattering model: diffuse, mirror, glass, metallic-roughness, ...")
    bounce: Literal["reflected", "transmitted"] | None = Field(description="side of the surface on which the path continues")
    pdf: float | None = Field(
        description="pdf per steradian of each sampled direction, two if the path splits; null: a delta distribution"
    )
    survival: float | None = Field(description="survival probability of Russian roulette; null: not applied")
    distance: float | None = Field(description="distance from the last vertex; null: infinite")
    point: Numbers | None = Field(description="position; null: infinitely far")
    normal: Numbers | None = Field(description="unit shading normal; null: no surface")
    direction: Numbers = Field(description="direction of the incident ray")
    throughput: Numbers = Field(description="path throughput at this vertex")
    emitted: Numbers = Field(description="radiance that its emission contributes to the sample")
    emitted_weight: float | None = Field(
        description="its weight in multiple importance sampling; null: no emission, or not reported"
    )
    direct: Numbers = Field(description="radiance that the sampled light contributes to the sample")
    beside: Numbers = Field(
        [0.0, 0.0, 0.0], description="radiance that the path's second branch contributes, which begins at this vertex"
    )
    light: LightOut | None = Field(description="the sampled light; null: none, or not reported")
    spot: Spot


class PathOut(BaseModel):
    """The path of one sample. The sample's value is the sum of `emitted`, `direct` and `beside` of all vertices."""

    chosen: list[Choice] = Field(
        description="why this sample is listed: `asked` for by number, the `first`, the `median` or the `brightest`"
    )
    sample: int = Field(description="number of the sample within the pixel, from 0")
    value: list[float] | None = Field(description="value in the film; null: NaN or infinite, and left out")
    end: Ending | None = Field(description="why the path ended")
    time: float = Field(description="time within the shutter interval, 0 to 1")
    vertices: list[PathVertexOut] = Field(description="vertices of the path, from the camera on")


class ExplainedOut(BaseModel):
    """Explanation of a pixel's colour: the paths of some of its samples, vertex by vertex."""

    x: int = Field(description="column of the pixel, from the left")
    y: int = Field(description="row of the pixel, from the top")
    frame: float = Field(description="number of the frame; 0 for a still")
    samples: int = Field(description="number of samples that were rendered again, from the first on")
    mean: list[float] | None = Field(description="mean of the finite samples")
    equals_film: bool | None = Field(
        description="whether the sum of the samples equals the film bit by bit; null: the film has other samples, or workers of "
        "another kind rendered it"
    )
    worker: str | None = Field(description="name of the worker that traced the paths; null: unknown")
    paths: list[PathOut] = Field(description="paths of the listed samples")


@router.get("/{id}/explain", response_model=ExplainedOut)
def explain(
    id: str,
    farm: FarmDependency,
    x: Annotated[int, Query(ge=0, description="column of the pixel, from the left")],
    y: Annotated[int, Query(ge=0, description="row of the pixel, from the top")],
    frame: Annotated[
        float, Query(ge=0, le=MAX_FRAME, multiple_of=0.5, allow_inf_nan=False, description="number of the frame")
    ] = 0.0,
    sample: Annotated[int | None, Query(ge=0, lt=MAX_SPP, description="number of another sample to return")] = None,
) -> ExplainedOut:
    """Returns the paths of a few of a pixel's samples: the first, one of median luminance, and the brightest of all.

    A worker renders the pixel's samples again, with the job's settings and sample numbers. sample: number of one more sample to
    return. 409 if the samples cannot be rendered any more, 503 if no worker can render them now, 504 if no slot was free in
    time.
    """
    job = find_job(id, farm)
    film = find_film(id, frame, farm)
    at, tile = tile_at(film, x, y)
    scene, row = _rows(job, frame_key(frame), farm)
    kind = _kind(job, scene, farm)
    sums, count = _film_sums(film, frame_key(frame), at, x - tile.x, y - tile.y)
    work = _explain_request(job, scene, row, kind, x, y, count, sample)
    found = farm.explaining.explain(work, kind)
    try:
        return _explained_out(found, scene, film.film_exponent, (x, y, frame), sums if kind == job.kind else None, count)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):  # a worker's answer is untrusted
        raise unreadable_answer() from None


def _explained_out(
    found: dict[str, Any], scene: Scene, film_exponent: int, at: tuple[int, int, float], sums: list[int] | None, count: int
) -> ExplainedOut:
    """Builds the response from a worker's explanation.

    found: the explanation (worker/work/explain.py). at: x, y and frame number. sums: the film's sums of the pixel's `count`
    samples; None if workers of another kind rendered the film.
    """
    names: dict[str, Any] = (scene.info or {}).get("names") or {}
    for path in found["paths"]:
        for vertex in path["vertices"]:
            for of in ("object", "material"):
                known, number = names.get(f"{of}s", []), vertex[of]
                vertex[f"{of}_name"] = known[number] if number is not None and 0 <= number < len(known) else None
    quantum = 2.0**-film_exponent
    mean = [value * quantum / found["finite"] for value in found["sums"]] if found["finite"] else None
    is_all = sums is not None and count == found["samples"]
    equals = [*found["sums"], found["finite"]] == sums if is_all else None
    about = {**dict(zip(("x", "y", "frame"), at, strict=True)), "samples": found["samples"], "mean": mean}
    return ExplainedOut.model_validate({**about, "equals_film": equals, "worker": found["worker"], "paths": found["paths"]})


def _rows(job: Job, key: int, farm: Farm) -> tuple[Scene, Frame | None]:
    with farm.sessions() as session:
        scene, row = session.get(Scene, job.compiled_scene_id), session.get(Frame, (job.id, key))
    if scene is None or not scene.compiled:
        raise Conflict(
            Sentence("pixel-scene-deleted", "The job's scene was deleted, so no paths can be traced through it. Upload it again.")
        )
    return scene, row


def _kind(job: Job, scene: Scene, farm: Farm) -> str:
    """Returns the kind of worker that explains the pixel: the one that renders the job, which reproduces its paths exactly.

    If no worker of that kind can explain it, returns a kind for which the scene is compiled. Raises Unavailable if there is
    none yet.
    """
    kinds = farm.explaining.kinds()
    if job.kind in kinds and job.kind in scene.compiled:
        return job.kind
    for kind in kinds:
        if kind in scene.compiled:
            return kind
    farm.events.publish(PreparationRequested(scene.id, kinds[0]))
    raise Unavailable(
        Sentence("pixel-scene-preparing", "The scene is being prepared for the connected workers. Try again in a moment."),
        5.0,
    )


def _film_sums(film: Film, key: int, at: int, x: int, y: int) -> tuple[list[int] | None, int]:
    """Returns a pixel's sums in the film, for colour and sample count, and the number of consecutive samples from sample 0.

    key: key of the frame (2 * frame number). at: number of the tile. x, y: pixel within the tile. The sums are None if the film
    has samples after a gap, or more than can be explained.
    """
    before, sums, after = film.coverage(key, at), film.tile_sums(key, at), film.coverage(key, at)
    count = after.prefix
    if sums is None or before.total != after.total or after.total != count or count > MAX_SAMPLES:
        return None, count
    pixel = sums[:, y, x]
    return [*map(int, pixel[COLOR]), int(pixel[SAMPLES])], count


def _explain_request(
    job: Job, scene: Scene, row: Frame | None, kind: str, x: int, y: int, count: int, sample: int | None
) -> ExplainPixel:
    try:
        found = frame_scene(job, scene, row, kind)
    except SettingsError as error:
        raise Conflict(
            Sentence(
                "pixel-paths-unavailable", "The paths of this picture cannot be traced: {error}. Render it again.", error=error
            )
        ) from None
    if found is None:
        raise Conflict(
            Sentence(
                "pixel-frame-not-prepared", "The frame is not prepared yet, so its pixels cannot be explained. Try again later."
            )
        )
    moment = None if found.own else found.moment
    return ExplainPixel("", job.id, found.own or found.base, found.settings, x, y, min(count, MAX_SAMPLES), sample, moment)
