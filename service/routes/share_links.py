"""/api/jobs/{id}/links and /api/shared: links that show one job to people without an account."""

from __future__ import annotations

from typing import Annotated, Literal

from fastapi import Query, Request
from fastapi.responses import Response
from pydantic import BaseModel, ConfigDict, Field
from starlette.concurrency import run_in_threadpool

from renderer.frames import frame_key, parse_frames
from renderer.sentences import Sentence
from service.access.keys import Share
from service.access.roles import OWNER, Role
from service.errors import OverQuota
from service.farm import Farm
from service.http.curve_name import CurveName
from service.http.farm import FarmDependency
from service.http.routers import api_router
from service.http.share_links import ShareDependency, may_comment
from service.http.visit import VisitDependency
from service.jobs.describe import describe
from service.jobs.lookup import find_job, find_picture
from service.models.jobs import JobState
from service.models.notes import ReviewOut
from service.routes import frames
from service.store.models import FINAL_STATES, Key

__all__ = ["router"]

router = api_router(prefix="/api", tags=["jobs"])

DAY_S = 86400.0
MAX_DAYS = 365
MAX_DENOISED = 20  # pictures within access.DENOISING_WINDOW_S, besides those that are stored
PAGE = "shared/"
DENOISE_HELP = "denoised; waits for a worker. While the job renders, the picture is a preview: see `preview` of a job's image"

Permission = Literal["view", "comment"]


class ShareLinkIn(BaseModel):
    """A link to create. days: the link's lifetime. permission: view: the picture alone; comment: also notes and a verdict."""

    model_config = ConfigDict(extra="forbid")

    permission: Permission = Field("view", description="`view`: the picture only; `comment`: also notes and a verdict")
    days: float = Field(7.0, gt=0, le=MAX_DAYS, allow_inf_nan=False, description="lifetime in days")


class ShareLinkOut(BaseModel):
    """A link without its secret. user: the user who created it."""

    id: str = Field(description="id of the link, without its secret")
    user: str = Field(description="user who created the link")
    permission: Permission = Field(description="`view`: the picture only; `comment`: also notes and a verdict")
    created: float = Field(description="Unix time in seconds")
    expires: float | None = Field(description="Unix time of its end; null: never")


class NewShareLink(ShareLinkOut):
    """A new link. path: the link's URL relative to the service's root, with the secret; returned only this once."""

    path: str = Field(description="URL relative to the service's root, with the secret; no later request returns it")


class SharedJob(BaseModel):
    """The properties of a job that a link shows."""

    name: str = Field(description="name of the job")
    state: JobState = Field(description="state of the job")
    progress: float = Field(description="0 to 1")
    width: int | None = Field(description="picture width in pixels")
    height: int | None = Field(description="picture height in pixels")
    samples: int = Field(description="samples in the film, over all pixels and frames")
    samples_per_pixel: int | None = Field(description="goal: samples per pixel; null: the goal is a noise level or a time")
    frames: list[float] = Field(description="numbers of the frames; a still has one")
    expires: float | None = Field(description="Unix time of the link's end")
    exposure: float = Field(description="stops by which the page brightens the picture by default")
    tonemap: str = Field(description="tone curve with which the page shows the picture by default")
    may_comment: bool = Field(description="whether the link allows notes and a verdict")
    review: ReviewOut | None = Field(description="verdict and counts of notes; null: none, or the link only shows the picture")


@router.get("/jobs/{id}/links", response_model=list[ShareLinkOut])
def list_share_links(id: str, farm: FarmDependency) -> list[ShareLinkOut]:
    """Lists the valid links to a job, newest first."""
    find_job(id, farm)
    return [_share_out(row) for row in farm.access.keys.shares_of(id)]


@router.post("/jobs/{id}/links", status_code=201, response_model=NewShareLink)
def make_share_link(id: str, body: ShareLinkIn, visit: VisitDependency, farm: FarmDependency) -> NewShareLink:
    """Creates a link that shows this job, and nothing else, without an account.

    The link is valid only as long as its creator may see the job, and allows notes only as long as its creator may change it.
    """
    find_job(id, farm)
    secret, row = farm.access.keys.create(
        "share", visit.user or OWNER, Role.VIEW, id, body.days * DAY_S, comments=body.permission == "comment"
    )
    return NewShareLink(**_share_out(row).model_dump(), path=f"{PAGE}#{secret}")


@router.delete("/jobs/{id}/links/{link}", status_code=204)
def withdraw_share_link(id: str, link: str, farm: FarmDependency) -> None:
    """Revokes a link at once."""
    farm.access.keys.withdraw_share(id, link)


@router.get("/shared", response_model=SharedJob)
def get_shared_job(share: ShareDependency, farm: FarmDependency, response: Response) -> SharedJob:
    """Returns the job that a link shows. The link's secret is sent as the bearer token."""
    response.headers["Cache-Control"] = "no-store"
    return _shared_job(share, farm)


@router.get("/shared/image.{extension}", response_class=Response, responses={200: frames.IMAGE})
async def get_shared_image(
    extension: Literal["png", "jpg"],
    share: ShareDependency,
    request: Request,
    farm: FarmDependency,
    visit: VisitDependency,
    frame: Annotated[float, Query(allow_inf_nan=False, description="number of the frame")] = 0.0,
    denoise: Annotated[bool, Query(description=DENOISE_HELP)] = False,
    exposure: Annotated[float, Query(ge=-32, le=32, allow_inf_nan=False, description="stops")] = 0.0,
    tonemap_curve: CurveName = "neutral",
    mix: Annotated[str, Query(max_length=4000, description=frames.MIX_HELP)] = "",
) -> Response:
    """Returns the picture, as rendered so far, of the job that a link shows. The link's secret is sent as the bearer token."""
    job = await run_in_threadpool(_shared_job, share, farm)
    number = frame if frame in job.frames else job.frames[0]
    denoise = denoise and not (mix.strip() and job.state not in FINAL_STATES)  # a mix has no previews
    if denoise and job.state in FINAL_STATES:  # otherwise a preview, for which workers have a share of their time
        await run_in_threadpool(_check_denoising, share, number, farm, is_mix=bool(mix.strip()))
    answer = await frames.image(
        *(share.job, number, extension, request, farm, visit),
        denoise=denoise,
        preview=denoise and job.state not in FINAL_STATES,
        exposure=exposure,
        tonemap_curve=tonemap_curve,
        mix=mix,
    )
    answer.headers["Cache-Control"] = "no-store"
    return answer


def _check_denoising(share: Share, number: float, farm: Farm, is_mix: bool) -> None:
    """Raises OverQuota if a picture must be denoised, and many were for this link. That takes 20 s of a core per megapixel."""
    find = farm.engine.denoised_lights if is_mix else farm.engine.denoised
    if find(share.job, frame_key(number), find_picture(share.job, number, farm)) is not None:
        return
    if (seconds := farm.access.link_denoising_rate.count([(("link", share.id), MAX_DENOISED)])) is not None:
        raise OverQuota(
            Sentence(
                "share-link-denoised-often",
                "Too many pictures were denoised for this link. Try again in {seconds} s, or leave denoise out.",
                seconds=max(1, round(seconds)),
            ),
            seconds,
        )


def _shared_job(share: Share, farm: Farm) -> SharedJob:
    job = describe(share.job, farm)
    numbers = parse_frames(job.shot.frames) if job.shot else [float(frame.number) for frame in job.frames]
    return SharedJob(
        name=job.name,
        state=job.state,
        progress=job.progress,
        width=job.width,
        height=job.height,
        samples=job.samples,
        samples_per_pixel=job.spp,
        frames=numbers or [0.0],
        expires=share.expires,
        exposure=job.exposure,
        tonemap=job.tonemap,
        may_comment=(comments := may_comment(share, farm)),
        review=job.review if comments else None,
    )


def _share_out(row: Key) -> ShareLinkOut:
    permission: Permission = "comment" if row.comments else "view"
    return ShareLinkOut(id=row.id, user=row.user, permission=permission, created=row.created, expires=row.expires)
