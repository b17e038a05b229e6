"""/api/jobs/{id}: all frames of a shot (a job with several frames) as a zip file or a movie."""

from __future__ import annotations

import re
from collections.abc import AsyncIterator
from dataclasses import replace
from functools import partial
from typing import Annotated, Literal

from fastapi import Query, Request, Response
from fastapi.responses import StreamingResponse
from starlette.concurrency import iterate_in_threadpool, run_in_threadpool

from renderer import aovs
from renderer.errors import SettingsError
from renderer.frames import frame_key, frame_name, frame_number, parse_frames
from renderer.image.tonemap import Curve
from renderer.sentences import Sentence, with_full_stop
from service.errors import Conflict, Invalid
from service.farm import Farm
from service.http.curve_name import CurveName
from service.http.farm import FarmDependency
from service.http.file_names import content_disposition, title_of
from service.http.head_requests import headers_response, is_head
from service.http.routers import api_router
from service.http.visit import VisitDependency
from service.jobs.describe_frames import frame_numbers
from service.jobs.lookup import film_of, find_job, names_of_ids, without_samples
from service.jobs.motion import motion_vectors_of
from service.scheduling.jobs.active_frame import FrameNumbers
from service.shot import Shot
from service.store.films import Film
from service.store.models import FINAL_STATES, Job, Scene
from service.watching.movie import MOVIE_MEDIA
from service.watching.pictures import PictureRequest, picture_file, picture_memory, plane_names
from service.watching.shot_files import ZipStream, movie, movie_memory

__all__ = ["router"]

router = api_router(prefix="/api/jobs/{id}", tags=["frames"])

CHECK_EVERY_S = 1.0
DEFAULT_FPS = 24.0
Frames = Annotated[str | None, Query(max_length=2000, description="only these frames, such as 10-20 or 7,9")]
Exposure = Annotated[float, Query(ge=-32, le=32, allow_inf_nan=False, description="stops; for png and jpg")]


@router.get("/frames.zip", response_class=Response, responses={200: {"content": {"application/zip": {}}}})
async def frames_zip(
    id: str,
    request: Request,
    farm: FarmDependency,
    visit: VisitDependency,
    format: Annotated[Literal["exr", "png", "jpg"], Query(description="format of the pictures")] = "exr",
    which: Annotated[Literal["finished", "all", "coming"], Query(description="which frames: see above")] = "finished",
    frames: Frames = None,
    aov: Annotated[str, Query(max_length=200, description="for exr: layers beside the colour, as normal,depth or all")] = "color",
    exposure: Exposure = 0.0,
    tonemap_curve: CurveName = "neutral",
) -> StreamingResponse:
    """Streams a zip with the frames as numbered files.

    which: `finished`: the finished frames; `all`: all frames with samples, as they are now; `coming`: all frames, each as soon
    as it is finished.
    """
    job = await run_in_threadpool(find_job, id, farm)
    picture = _picture_request(format, aov, exposure, await run_in_threadpool(farm.curves.find, tonemap_curve), job)
    if any(map(aovs.is_matte, picture.planes)):
        picture = replace(picture, names_of_ids=await run_in_threadpool(names_of_ids, id, farm))
    found = await run_in_threadpool(_selected_frames, job, frames, farm)
    film = await run_in_threadpool(film_of, job, farm)
    if which != "coming" and not any(_is_selected(frame, which) for frame in found.values()):
        raise Conflict(
            Sentence(
                "shot-without-finished-frame", "No frame is finished yet. Ask for which=all, or wait for each with which=coming."
            )
        )
    if which != "coming" and await run_in_threadpool(lambda: film.is_empty):
        raise without_samples(job, farm)
    headers = {
        "Content-Disposition": content_disposition(f"{_title(job, frames)}.{format}.zip", "attachment"),
        "Cache-Control": "no-store",
    }
    if is_head(request):
        return headers_response(headers, "application/zip")
    stream = _zip_frames(job, film, picture, frames, which, farm, visit.queue)
    return StreamingResponse(stream, media_type="application/zip", headers=headers)


@router.get(
    "/movie.{extension}",
    response_class=Response,
    responses={200: {"content": {media: {} for media in MOVIE_MEDIA.values()}, "description": "The film."}},
)
async def get_movie(
    id: str,
    request: Request,
    farm: FarmDependency,
    visit: VisitDependency,
    extension: Literal["mp4", "webm", "webp"],
    frames: Frames = None,
    fps: Annotated[
        float | None, Query(ge=1, le=240, allow_inf_nan=False, description="frames per second; by default those of the shot")
    ] = None,
    width: Annotated[int | None, Query(ge=16, description="a smaller film, at least this wide")] = None,
    exposure: Exposure = 0.0,
    tonemap_curve: CurveName = "neutral",
) -> StreamingResponse:
    """Returns the frames that have samples as a movie: H.264, AV1, or animated WebP; tone-mapped as for PNG."""
    curve = await run_in_threadpool(farm.curves.find, tonemap_curve)
    picture = PictureRequest(extension, exposure=exposure, curve=curve, width=width)
    job = await run_in_threadpool(find_job, id, farm)
    chosen = await run_in_threadpool(_selected_frames, job, frames, farm)
    shown = {key: frame.samples for key, frame in chosen.items() if frame.samples}
    if not shown:
        raise Conflict(Sentence("shot-without-samples", "No frame has samples yet. Try again in a moment."))
    film = await run_in_threadpool(film_of, job, farm)
    if await run_in_threadpool(lambda: film.is_empty):
        raise without_samples(job, farm)
    speed = await run_in_threadpool(_fps, job, farm) if fps is None else fps
    keys, content = list(shown), tuple(shown.items())
    headers = {"Content-Disposition": content_disposition(f"{_title(job, frames)}.{extension}"), "Cache-Control": "no-cache"}
    headers["X-Frames"] = str(len(keys))
    if is_head(request):
        return headers_response(headers, MOVIE_MEDIA[extension])
    make = partial(movie, film, keys, picture, speed, farm.settings.data / "tmp")
    made = await farm.pictures.run((id, "movie", picture, speed, content), movie_memory(film, picture), make, user=visit.queue)
    headers["Content-Length"] = str(made.size)
    return StreamingResponse(made.pieces(), media_type=MOVIE_MEDIA[extension], headers=headers)


async def _zip_frames(
    job: Job, film: Film, picture: PictureRequest, frames: str | None, which: str, farm: Farm, user: str
) -> AsyncIterator[bytes]:
    stream = ZipStream()
    folder = farm.settings.data / "tmp"
    done: set[int] = set()
    with farm.broadcast.listen(job.id) as listener:
        while True:
            now = await run_in_threadpool(find_job, job.id, farm)
            found = await run_in_threadpool(_selected_frames, now, frames, farm)
            for key, frame in found.items():
                if key in done or not _is_selected(frame, which):
                    continue
                done.add(key)
                if aovs.MOTION in picture.planes:
                    picture = replace(picture, motion=await motion_vectors_of(now, frame_number(key), film, farm))
                about = (job.id, "zip", key, film.version(key), picture)
                made = await farm.pictures.run(
                    about, picture_memory(film, picture), picture_file, film, key, picture, folder, user=user
                )
                name = frame_name(f"{_title(job)}.####.{picture.extension}", frame_number(key))
                async for piece in iterate_in_threadpool(stream.file(name, made)):
                    yield piece
            is_over = now.state in FINAL_STATES or all(frame.state in ("finished", "failed") for frame in found.values())
            if which != "coming" or is_over or farm.broadcast.closing:
                break
            await listener.wait(CHECK_EVERY_S)
    yield stream.final_bytes()


def _is_selected(frame: FrameNumbers, which: str) -> bool:
    return frame.samples > 0 if which == "all" else frame.state == "finished"


def _picture_request(format: str, aov: str, exposure: float, curve: Curve, job: Job) -> PictureRequest:
    planes = plane_names(map(str.strip, aov.split(",")), job.settings or {})
    picture = PictureRequest(format, planes, bool(planes), exposure, curve)
    picture.check()
    return picture


def _selected_frames(job: Job, frames: str | None, farm: Farm) -> dict[int, FrameNumbers]:
    """Returns the state of the selected frames by frame key, in order.

    frames: the query parameter; None: all frames of the job.
    """
    try:
        keys = None if frames is None else set(map(frame_key, parse_frames(frames)))
    except SettingsError as error:
        raise Invalid(with_full_stop(error)) from None
    with farm.sessions() as session:
        found = frame_numbers(job, session, farm.engine)
    return {key: frame for key, frame in found if keys is None or key in keys}


def _fps(job: Job, farm: Farm) -> float:
    shot = Shot.parse(job.shot)
    if shot is not None and shot.fps is not None:
        return shot.fps
    with farm.sessions() as session:
        scene = session.get(Scene, job.scene)
    return float(((scene.info if scene else None) or {}).get("fps") or DEFAULT_FPS)


def _title(job: Job, frames: str | None = None) -> str:
    """Returns the title for the file's name: the job's name, and the selected frame numbers if `frames` is given."""
    which = re.sub(r"[^0-9.-]+", "-", frames or "").strip("-.")[:100]
    return f"{title_of(job)}.{which}" if which else title_of(job)
