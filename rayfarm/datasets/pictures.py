"""The rendered views of a data set, from this process or from a farm, as they are finished."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from rayfarm.datasets.request import Request, scene_files
from renderer.frames import frames_text
from renderer.scene.animation import Moment
from renderer.settings import View

if TYPE_CHECKING:
    from rayfarm.client import Client
    from rayfarm.datasets.folder import Folder
    from rayfarm.reading import ConfinedScene
    from rayfarm.responses import Frame

__all__ = ["RenderedView", "rendered_by_farm", "rendered_here"]

VIEWS_PER_JOB = 2000  # their JSON fits a request's body
POLL_S = 0.2
NEAR = 64  # frames that are requested at a time


class RenderedView(NamedTuple):
    """A view's picture. digest: the SHA-256 of its film, the same wherever and however often it is rendered."""

    number: int
    data: bytes
    digest: str


def rendered_here(
    request: Request, stage: ConfinedScene, settings: Callable[[dict[str, Any]], Any], numbers: Sequence[int]
) -> Generator[RenderedView]:
    """Yields the pictures of the views `numbers`, rendered in this process. settings: as for Annotator."""
    from dataclasses import replace

    from rayfarm.graphics_card import device_card
    from rayfarm.rendering import Clock, load_kernels, whole_frame
    from renderer.film import alpha, digest, mean
    from renderer.image import encode
    from renderer.render import RenderStats
    from renderer.work import most_samples

    picture, threads = request.arguments.picture, request.arguments.threads
    with ExitStack() as stack:
        card = stack.enter_context(device_card(request.arguments.device))
        is_loaded = False
        for number in numbers:
            compiled, summary = stage.scene_at(_moment(request, number))
            wanted = replace(settings(summary), view=request.views[number], views=())
            if not is_loaded:
                load_kernels(wanted, compiled, Clock(), card)
                is_loaded = True
            count = most_samples(picture.spp, picture.noise, picture.time_limit, summary["defaults"])
            limits = picture.noise, picture.time_limit, RenderStats()
            sums = whole_frame(compiled, wanted, count, threads, *limits, lambda done, total: None, card)
            exponent, groups = wanted.film_exponent, len(wanted.light_planes)
            coverage = alpha(sums, exponent, groups) if wanted.is_transparent else None
            data = encode.encode(mean(sums, exponent), request.picture_format, alpha=coverage)
            yield RenderedView(number, data, digest(sums))


def rendered_by_farm(
    request: Request, scene: Path, farm: Client, folder: Folder, numbers: Sequence[int]
) -> Generator[RenderedView | None]:
    """Yields the pictures of the views `numbers`, rendered by a farm, in the order in which they end; None if there is no news.

    The views are the frames of one job, or of several for thousands of views. Jobs that an interrupted run has left are taken up
    again. Raises ClientError, after all other pictures, if frames failed.
    """
    from rayfarm.client import ClientError

    jobs = _unfinished_jobs(farm, folder, numbers)
    taken = {number for views in jobs.values() for number in views}
    jobs |= _submitted(request, scene, farm, [number for number in numbers if number not in taken])
    folder.remember_jobs(farm.url, jobs)
    wanted, failures = set(numbers), dict[int, str]()
    for job, views in jobs.items():
        left = {number for number in views if number in wanted}
        finished = -1
        while left:
            found = farm.job(job)
            states = found.shot.states if found.shot is not None else {}
            ended = states.get("finished", 0) + states.get("failed", 0)
            if ended != finished or found.is_over:
                finished = ended
                running = 0 if found.is_over else len(views) - ended
                for frame in _ended_frames(farm, job, views, left, running):
                    number = int(frame.number)
                    left.discard(number)
                    if frame.state == "failed":
                        failures[number] = frame.error or "no reason given"
                        continue
                    data = farm.image(job, request.picture_format, number)
                    yield RenderedView(number, data, farm.digest(job, number))
            if left and found.is_over:
                why = f"failed: {found.error or 'no reason given'}" if found.state == "failed" else f"was {found.state}"
                raise ClientError(f"The job {job} {why}")
            if left:
                yield None
                time.sleep(POLL_S)
    if failures:
        number, why = next(iter(sorted(failures.items())))
        raise ClientError(f"{len(failures)} of {len(numbers)} views failed, the first is {number}: {why}")


def _ended_frames(farm: Client, job: str, views: list[int], left: set[int], running: int) -> list[Frame]:
    """Returns the frames of a job that have ended, of the views `left`. views: all of the job, ascending. running: of these.

    Frames end nearly in order, so only those after the first one left are requested, and all if some are missing there: a list
    of thousands for each view that ends would take the farm longer than the views.
    """

    def those_ended(frames: list[Frame]) -> list[Frame]:
        return [frame for frame in frames if frame.state in ("finished", "failed") and frame.number in left]

    near = those_ended(farm.frames(job, offset=views.index(min(left)), limit=NEAR))
    return near if len(left) - len(near) <= running else those_ended(farm.frames(job))


def _unfinished_jobs(farm: Client, folder: Folder, numbers: Sequence[int]) -> dict[str, list[int]]:
    """Returns the jobs of an interrupted run that have or will have some of the views."""
    from rayfarm.client import ClientError

    missing, found = set(numbers), dict[str, list[int]]()
    for job, views in folder.jobs(farm.url).items():
        kept = [number for number in views if number in missing]
        with suppress(ClientError):  # deleted in the meantime
            if kept and farm.job(job).state not in ("failed", "cancelled"):
                found[job] = views
                missing -= set(kept)
    return found


def _submitted(request: Request, scene: Path, farm: Client, numbers: Sequence[int]) -> dict[str, list[int]]:
    """Uploads the scene once and submits the views as jobs; returns their numbers by job."""
    from rayfarm.library.farm_render import job_request

    if not numbers:
        return {}
    placement = request.arguments.picture.placement()._asdict()
    uploaded = farm.upload(scene_files(scene, request.vary), name=scene.stem, **placement)
    ready = farm.wait_for_scene(uploaded.id)
    body = job_request(farm, ready, request.arguments)
    body.pop("view", None)  # `height` in pixels is also the name of an orthographic view's
    vary = {} if request.vary is None else {"vary": request.vary}
    jobs: dict[str, list[int]] = {}
    for first in range(0, len(numbers), VIEWS_PER_JOB):
        part = sorted(numbers[first : first + VIEWS_PER_JOB])
        views = [_view_json(request.views[number]) for number in part]
        job = farm.submit(ready.id, **{**body, **vary, "views": views, "frames": frames_text(part)})
        jobs[job.id] = part
    return jobs


def _view_json(view: View) -> dict[str, Any]:
    """Returns a view as a request has it, without settings that have their default."""
    usual = View((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    return {name: value for name, value in view.to_json().items() if name in ("eye", "target") or value != getattr(usual, name)}


def _moment(request: Request, number: int) -> Moment:
    return Moment(float(number), request.arguments.moment.fps, request.arguments.moment.clip)
