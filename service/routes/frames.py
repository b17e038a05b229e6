"""/api/jobs/{id}/frames/{n}: pictures of frames, available from the first sample on.

A frame without samples returns 409 with an explanation. Only /film, which clients fetch first, responds with an empty picture
until the job ends.
"""

from __future__ import annotations

import hashlib
import math
import re
from dataclasses import replace
from functools import partial
from typing import Annotated, Any, Literal

import anyio
import anyio.to_thread
import numpy as np
from fastapi import Query, Request, Response
from fastapi.responses import PlainTextResponse, StreamingResponse
from pydantic import BaseModel, Field
from starlette.concurrency import run_in_threadpool

from protocol.contract import SAMPLES_HEADER
from renderer import aovs
from renderer import film as film_math
from renderer.frames import MAX_FRAMES, frame_key, frame_text
from renderer.image.tonemap import key_of
from renderer.sentences import Sentence
from renderer.settings import group_names
from service.errors import Invalid
from service.farm import Farm
from service.http.curve_name import CurveName
from service.http.farm import FarmDependency
from service.http.file_names import content_disposition, picture_name
from service.http.head_requests import headers_response, is_head
from service.http.paths import Number
from service.http.routers import api_router
from service.http.visit import VisitDependency
from service.jobs.denoised import denoised_artifact, denoised_lights_artifact
from service.jobs.describe_frames import frame_out, frames_json
from service.jobs.frame_workers import FrameWorkersOut, frame_workers
from service.jobs.lookup import find_film, find_job, find_picture, frame_not_found, names_of_ids, tile_at, without_samples
from service.jobs.motion import motion_vectors_of
from service.models.jobs import FrameOut, FrameState
from service.store import bands
from service.store.films import Film
from service.store.models import FINAL_STATES, Job
from service.watching import film_packet
from service.watching.deep_picture import deep_picture, deep_picture_memory
from service.watching.mix import gains_of_mix
from service.watching.pictures import MEDIA, PictureRequest, picture_file, picture_memory, plane_names

__all__ = ["router"]

router = api_router(prefix="/api/jobs/{id}/frames", tags=["frames"])

IMAGE = {"content": {media: {} for media in MEDIA.values()}, "description": "The picture."}
DEEP = {"content": {MEDIA["exr"]: {}}, "description": "The deep picture."}
FILM = {"content": {"application/octet-stream": {}}, "description": "The film."}
AOV_HELP = (
    f"color, or one of {', '.join(aovs.NAMES)}; for exr also a list as color,normal, or all, which is all but motion: layers "
    "beside the colour. motion waits until a worker has made it. light:NAME is the light of a light group of the job, lights "
    "that of all of them; path:NAME that of a light path, paths all of them; cryptomatte is the mattes of a job with that "
    "setting, alpha the coverage with background transparent"
)
IN_SHOT_HELP = (
    "with denoise, of a shot's frame: averaged along the motion vectors with up to two finished frames before and after it, so "
    "that the shot flickers less; waits for the vectors, too"
)
PREVIEW_HELP = (
    "with denoise: a quick denoised preview, of the samples that X-Samples says, unless the denoised picture of all samples is "
    "stored already; the response then has X-Preview: true. While the job renders it is renewed when the samples have doubled "
    "(grown by a quarter below 64 samples per pixel), for at most a twentieth (a quarter) of the workers' time; the request "
    "waits up to 10 s for that"
)
WAIT_HELP = "false, with preview: the latest preview, also if a better one is due, or 409 if there is none"
MIX_HELP = (
    "the colour as a weighted sum of the job's light groups: NAME:GAIN or NAME:RED/GREEN/BLUE, separated by commas, as "
    "key:0.5,fill:1/0.8/0.6; groups that are left out have the gain 1"
)


class Pixel(BaseModel):
    """Values of a pixel in the film: means over its samples, scene-linear; positions and normals in world space."""

    x: int = Field(description="column of the pixel, from the left")
    y: int = Field(description="row of the pixel, from the top")
    samples: int = Field(description="number of samples")
    color: list[float] = Field(description="linear Rec.709")
    error: float | None = Field(description="standard error of the luminance; null: too few samples")
    albedo: list[float] = Field(description="linear Rec.709, 0 to 1")
    normal: list[float] = Field(description="unit vector in world space")
    depth: float = Field(description="distance from the camera, in the scene's unit")
    position: list[float] = Field(description="point in world space")
    object: int | None = Field(description="number of the first visible object; null: none")
    material: int | None = Field(description="number of the first visible material; null: none")
    object_name: str | None = Field(description="name of that object; null: none")
    material_name: str | None = Field(description="name of that material; null: none")
    alpha: float | None = Field(None, description="share of the pixel that is covered; null before a visible background")
    lights: dict[str, list[float]] | None = Field(
        None, description="the light of each light group, and of each light path as path:NAME; null without both"
    )


class Digest(BaseModel):
    """SHA-256 digest of a frame's sums and sample counts."""

    digest: str = Field(description="SHA-256 as hexadecimal digits")
    samples: int = Field(description="samples over all pixels")


@router.get("", response_model=list[FrameOut])
def list_frames(
    id: str,
    farm: FarmDependency,
    state: Annotated[FrameState | None, Query(description="only frames in this state")] = None,
    limit: Annotated[int | None, Query(ge=1, le=MAX_FRAMES, description="greatest number of frames; all by default")] = None,
    offset: Annotated[int, Query(ge=0, le=MAX_FRAMES, description="index of the first frame to return, from 0")] = 0,
) -> Response:
    """Lists the frames of a job in order, each with its state, samples, noise and error."""
    job = find_job(id, farm)
    with farm.sessions() as session:
        body = frames_json(job, session, farm.engine, state, (offset, limit))
    return Response(body, media_type="application/json")


@router.get("/{n}", response_model=FrameOut)
def get_frame(id: str, n: Number, farm: FarmDependency) -> FrameOut:
    """Returns one frame of a job: state, samples, noise and error, and the first of its samples excluded as NaN or infinite."""
    job = find_job(id, farm)
    with farm.sessions() as session:
        found = frame_out(job, session, farm.engine, frame_key(n))
    if found is None:
        raise frame_not_found(n)
    return found


@router.get("/{n}/image.{extension}", response_class=Response, responses={200: IMAGE, 304: {"description": "Not changed."}})
async def image(
    id: str,
    n: Number,
    extension: Literal["png", "exr", "jpg", "avif", "jxl", "hdr", "rgb9e5"],
    request: Request,
    farm: FarmDependency,
    visit: VisitDependency,
    aov: Annotated[str, Query(max_length=200, description=AOV_HELP)] = "color",
    denoise: Annotated[bool, Query(description="denoised; the request waits for a worker")] = False,
    in_shot: Annotated[bool, Query(description=IN_SHOT_HELP)] = False,
    preview: Annotated[bool, Query(description=PREVIEW_HELP)] = False,
    wait: Annotated[bool, Query(description=WAIT_HELP)] = True,
    exposure: Annotated[float, Query(ge=-32, le=32, allow_inf_nan=False, description="stops; not for exr, hdr and rgb9e5")] = 0.0,
    tonemap_curve: CurveName = "neutral",
    width: Annotated[int | None, Query(ge=16, description="a smaller copy, at least this wide")] = None,
    mix: Annotated[str, Query(max_length=4000, description=MIX_HELP)] = "",
    gain_map: Annotated[
        bool, Query(description="jpg with a gain map (Ultra HDR), by which HDR displays show brighter highlights")
    ] = False,
    visible: Annotated[bool, Query(description="png and jpg that would look black are exposed automatically")] = False,
) -> Response:
    """Returns the picture rendered so far. EXR, HDR and RGB9E5 are scene-linear; PNG and JPEG are tone-mapped.

    AVIF and JPEG XL have a high dynamic range (PQ): exposure applies, and a `tonemap` that is a view of a PQ display.
    The words of RGB9E5 are those of live tiles. The header X-Samples contains the number of its samples over all pixels; for a
    heat map, X-Span contains the range of values.
    """
    curve = await run_in_threadpool(farm.curves.find, tonemap_curve)
    job = await run_in_threadpool(find_job, id, farm)
    look = {"exposure": exposure, "curve": curve, "width": width, "visible": visible, "gain_map": gain_map}
    picture = _picture_request(extension, aov, mix, job, denoise=denoise, in_shot=in_shot, **look)
    is_preview = preview and denoise and not in_shot and not picture.lights
    film, version, samples = await run_in_threadpool(_film_state_with_samples, id, n, farm)
    asks_head = is_head(request)
    if not denoise or asks_head:
        denoised = None
    elif picture.lights:
        denoised = await denoised_lights_artifact(job, n, film, farm)
    else:
        denoised = await denoised_artifact(job, n, film, farm, in_shot=in_shot, is_preview=is_preview, waits=wait)
    if denoised is not None:
        version, samples, is_preview = denoised.version, denoised.samples, denoised.is_preview
        picture = replace(picture, denoised=partial(farm.blobs.open, denoised.sha256))
    headers = {
        "ETag": _etag(picture, f"{version} {denoise}{is_preview}"),
        "Cache-Control": "no-cache",
        SAMPLES_HEADER: str(samples),
    }
    if denoised is not None and is_preview:
        headers["X-Preview"] = "true"
    known = request.headers.get("if-none-match", "")
    if headers["ETag"] in known or known.strip() == "*":
        return Response(status_code=304, headers=headers)
    content = [_content_name(picture), "denoised" if denoise else ""]
    name = picture_name(job, n, samples, "-".join(filter(None, content)), extension)
    headers["Content-Disposition"] = content_disposition(name)
    if asks_head:
        if denoise:
            del headers["ETag"]  # the response has the ETag of the denoised picture
        return headers_response(headers, MEDIA[extension])
    if aovs.MOTION in picture.planes:
        picture = replace(picture, motion=await motion_vectors_of(job, n, film, farm))
    if any(map(aovs.is_matte, picture.planes)):
        picture = replace(picture, names_of_ids=await run_in_threadpool(names_of_ids, id, farm))
    folder = farm.settings.data / "tmp"
    made = await farm.pictures.run(
        (id, n, headers["ETag"]),
        picture_memory(film, picture),
        picture_file,
        film,
        frame_key(n),
        picture,
        folder,
        user=visit.queue,
    )
    headers["Content-Length"] = str(made.size)
    if made.span is not None:
        headers["X-Span"] = ",".join(f"{value:.6g}" for value in made.span)
    return StreamingResponse(made.pieces(), media_type=MEDIA[extension], headers=headers)


@router.get("/{n}/deep.exr", response_class=Response, responses={200: DEEP, 304: {"description": "Not changed."}})
async def deep(id: str, n: Number, request: Request, farm: FarmDependency, visit: VisitDependency) -> Response:
    """Returns the deep picture rendered so far, of a job with the setting `deep`: samples in depth with colour and alpha.

    Composited over each other, the samples of a pixel give the colour and alpha of image.exr.
    """
    job = await run_in_threadpool(find_job, id, farm)
    if not (job.settings or {}).get("deep"):
        raise Invalid(
            Sentence(
                "deep-not-rendered", "deep.exr: the job has no deep samples; set deep, for instance to 32, when it is rendered."
            )
        )
    film, version, samples = await run_in_threadpool(_film_state_with_samples, id, n, farm)
    headers = {"ETag": f'"{version}-deep"', "Cache-Control": "no-cache", SAMPLES_HEADER: str(samples)}
    if headers["ETag"] in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    headers["Content-Disposition"] = content_disposition(picture_name(job, n, samples, "deep", "exr"))
    if is_head(request):
        return headers_response(headers, MEDIA["exr"])
    key = (id, n, "deep", headers["ETag"])
    folder = farm.settings.data / "tmp"
    most = deep_picture_memory(film)
    made = await farm.pictures.run(key, most, deep_picture, film, frame_key(n), folder, user=visit.queue)
    headers["Content-Length"] = str(made.size)
    return StreamingResponse(made.pieces(), media_type=MEDIA["exr"], headers=headers)


@router.get("/{n}/film", response_class=Response, responses={200: FILM, 304: {"description": "Not changed."}})
async def film(id: str, n: Number, request: Request, farm: FarmDependency, visit: VisitDependency) -> Response:
    """Returns the colour of a whole frame and the sample count of each tile in one response, for a viewer that opens the job.

    See docs/live.md.
    """
    film, version, _ = await run_in_threadpool(_film_state, id, n, farm)
    gzip = "gzip" in request.headers.get("accept-encoding", "")
    headers = {"ETag": f'"{version}{"-gzip" if gzip else ""}"', "Cache-Control": "no-cache", "Vary": "Accept-Encoding"}
    if headers["ETag"] in request.headers.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    if gzip:
        headers["Content-Encoding"] = "gzip"
    if is_head(request):
        return headers_response(headers, "application/octet-stream")
    folder = farm.settings.data / "tmp"
    most = film_packet.packet_memory(film)
    key = (id, n, "film", headers["ETag"])
    made = await farm.pictures.run(key, most, film_packet.film_packet, film, frame_key(n), folder, gzip, user=visit.queue)
    headers["Content-Length"] = str(made.size)
    return StreamingResponse(made.pieces(), media_type="application/octet-stream", headers=headers)


@router.get("/{n}/pixel", response_model=Pixel)
async def pixel(
    id: str,
    n: Number,
    farm: FarmDependency,
    x: Annotated[int, Query(ge=0, description="column of the pixel, from the left")],
    y: Annotated[int, Query(ge=0, description="row of the pixel, from the top")],
) -> Pixel:
    """Returns the exact values of a pixel and its number of samples. x, y: from the upper left corner."""
    return await anyio.to_thread.run_sync(_pixel, id, n, farm, x, y, limiter=farm.tiles)


def _pixel(id: str, n: float, farm: Farm, x: int, y: int) -> Pixel:
    film = find_picture(id, n, farm)
    at, tile = tile_at(film, x, y)
    sums = film.tile_sums(frame_key(n), at)
    sums = (
        np.zeros((film_math.plane_count(len(film.groups), film.is_transparent), 1, 1), np.int64)
        if sums is None
        else sums[:, y - tile.y, x - tile.x, None, None]
    )
    values: dict[str, Any] = {name: aovs.values(sums, film.film_exponent, name)[0, 0].tolist() for name in aovs.AOVS}
    if not math.isfinite(values["error"]):
        values["error"] = None
    if film.is_transparent:
        values["alpha"] = float(aovs.values(sums, film.film_exponent, aovs.ALPHA, film.groups)[0, 0])
    if film.groups:
        values["lights"] = {
            name: film_math.mean(sums, film.film_exponent, film_math.group_planes(k))[0, 0].tolist()
            for k, name in enumerate(film.groups)
        }
    names = names_of_ids(id, farm)
    for kind in ("object", "material"):
        number, known = int(values[kind]) - 1, names.get(f"{kind}s", [])
        values[kind] = number if number >= 0 else None
        values[f"{kind}_name"] = known[number] if 0 <= number < len(known) else None
    return Pixel(x=x, y=y, color=film_math.mean(sums, film.film_exponent)[0, 0].tolist(), **values)


@router.get("/{n}/log", response_class=PlainTextResponse)
def tile_log(
    id: str,
    n: Number,
    farm: FarmDependency,
    x: Annotated[int, Query(ge=0, description="column of the pixel, from the left")],
    y: Annotated[int, Query(ge=0, description="row of the pixel, from the top")],
) -> str:
    """Returns the log of the tile with this pixel, one line per batch: worker, samples, duration, and warnings or failure.

    Of successful batches, it has only the latest 16 since the service started.
    """
    film = find_film(id, n, farm)
    at, _ = tile_at(film, x, y)
    about = re.compile(rf"\btile {at}, frame {re.escape(frame_text(n))}(?!\.?\d)")
    lines = [line for line in farm.engine.logs.text(id).decode(errors="replace").splitlines() if about.search(line)]
    lines += farm.engine.logs.tiles.text(id, frame_key(n), at).splitlines()
    return "".join(f"{line}\n" for line in sorted(lines))


@router.get("/{n}/workers", response_model=FrameWorkersOut)
def workers(id: str, n: Number, farm: FarmDependency) -> FrameWorkersOut:
    """Returns which workers rendered the samples of a frame, for each of its tiles."""
    return frame_workers(find_film(id, n, farm), frame_key(n))


@router.get("/{n}/digest", response_model=Digest)
async def digest(id: str, n: Number, farm: FarmDependency, visit: VisitDependency) -> Digest:
    """Returns the digest of a frame's sums. Equal requests give equal digests, whichever workers rendered them."""
    film, version, samples = await run_in_threadpool(_film_state_with_samples, id, n, farm)
    folder = farm.settings.data / "tmp"
    made = await farm.pictures.run(
        (id, n, "digest", version), bands.digest_memory(film), bands.digest, film, frame_key(n), folder, user=visit.queue
    )
    return Digest(digest=made, samples=samples)


def _picture_request(
    extension: str, aov: str, mix: str, job: Job, *, denoise: bool, in_shot: bool, **look: Any
) -> PictureRequest:
    """Returns the picture that the parameters of `image` request, without the files that workers make for it. Raises Invalid.

    look: fields of PictureRequest.
    """
    planes, in_layers = _requested_planes(aov, job)
    if in_shot and not denoise:
        raise Invalid(Sentence("in-shot-needs-denoise", "in_shot: only a denoised picture is averaged; add denoise=true."))
    groups = group_names((job.settings or {}).get("light_groups", ""))
    group = planes[0].removeprefix(aovs.LIGHT) if len(planes) == 1 and not in_layers and aovs.is_light(planes[0]) else None
    if denoise and planes and group not in groups:
        raise Invalid(
            Sentence("denoise-only-colour", "denoise: only the colour, or one light group, can be denoised; leave aov out.")
        )
    gains = gains_of_mix(mix, groups)
    if gains and planes:
        raise Invalid(Sentence("mix-only-colour", "mix: only the colour can be mixed; leave aov out."))
    of_lights = denoise and bool(planes or gains)
    if of_lights and in_shot:
        raise Invalid(
            Sentence("in-shot-without-lights", "in_shot: only the colour as rendered is averaged; leave aov and mix out.")
        )
    if of_lights and not gains:
        gains = tuple((1.0, 1.0, 1.0) if name == group else (0.0, 0.0, 0.0) for name in groups)
    picture = PictureRequest(extension, planes, in_layers, lights=len(groups) if of_lights else 0, gains=gains, **look)
    picture.check()
    return picture


def _etag(picture: PictureRequest, version: str) -> str:
    """Returns the ETag of a picture. version: of its samples, and how they are denoised."""
    look = f"{picture.exposure} {key_of(picture.curve)} {picture.width} {picture.visible} {picture.gains} {picture.gain_map}"
    key = f"{version} {picture.extension} {picture.planes} {picture.in_layers} {look}"
    return f'"{hashlib.sha256(key.encode()).hexdigest()[:32]}"'


def _content_name(picture: PictureRequest) -> str:
    """Returns the part of a file name that says what a picture shows; empty for the colour."""
    return "layers" if picture.in_layers else picture.planes[0] if picture.planes else "mix" if picture.gains else ""


def _requested_planes(text: str, job: Job) -> tuple[tuple[str, ...], bool]:
    """Returns the names of the requested planes, and whether they are layers in addition to the colour.

    text: the query parameter `aov`.
    """
    asked = [name.strip() for name in text.split(",")]
    names = plane_names(asked, job.settings or {})
    return names, bool(names) and (len(asked) > 1 or bool({"all", aovs.LIGHTS} & {*asked}))


def _film_state(id: str, n: float, farm: Farm) -> tuple[Film, str, int]:
    """Returns a frame's film, the version of its content, and the frame's number of samples. id: the job's. n: frame number.

    Raises Conflict if the job has ended and the frame has no samples.
    """
    film, job = find_film(id, n, farm), find_job(id, farm)
    samples = film.samples(frame_key(n))
    if not samples and job.state in FINAL_STATES:
        raise without_samples(job, farm, n)
    return film, film.version(frame_key(n)), samples


def _film_state_with_samples(id: str, n: float, farm: Farm) -> tuple[Film, str, int]:
    """Returns the same as `_film_state`, but also raises Conflict for a frame without samples while the job renders."""
    film = find_picture(id, n, farm)
    return film, film.version(frame_key(n)), film.samples(frame_key(n))
