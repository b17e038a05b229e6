"""The rendered views of a data set, from this process or from a farm, as they are finished."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from rayfarm.datasets.request import Request, scene_files, vary_of_scene
from renderer.frames import frames_text
from renderer.scene.animation import Moment
from renderer.settings import View

if TYPE_CHECKING:
    from rayfarm.client import Client
    from rayfarm.datasets.folder import Folder
    from rayfarm.reading import ConfinedScene
    from rayfarm.responses import Frame

__all__ = ["RenderedView", "rendered_by_farm", "rendered_here"]

VIEWS_PER_JOB = 500  # a film of a small view takes some megabytes on the farm's disk until its job is deleted
NEXT_JOB_AT = 100  # views left of a job when the next one is submitted, so that slots do not wait for it
POLL_S, LONGEST_POLL_S, POLLS_GROW_IN_S = 0.2, 1.0, 50.0  # polls of a long data set find several views each
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
    import warnings
    from dataclasses import replace
    from functools import partial

    from rayfarm.graphics_card import device_card, on_card_or_cores
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
            if not is_loaded or wanted.guiding != "off":  # each view has a guide of its own, which may need no kernel for guides
                load_kernels(wanted, compiled, Clock(), card)
                is_loaded = True
            count = most_samples(picture.spp, picture.noise, picture.time_limit, summary["defaults"])
            limits = picture.noise, picture.time_limit, RenderStats()
            render = partial(whole_frame, compiled, wanted, count, threads, *limits, lambda done, total: None)
            sums = on_card_or_cores(card, render, warnings.warn)
            exponent, groups = wanted.film_exponent, len(wanted.light_planes)
            coverage = alpha(sums, exponent, groups) if wanted.is_transparent else None
            data = encode.encode(mean(sums, exponent), request.picture_format, alpha=coverage)
            yield RenderedView(number, data, digest(sums))


def rendered_by_farm(
    request: Request, scene: Path, farm: Client, folder: Folder, numbers: Sequence[int]
) -> Generator[RenderedView | None]:
    """Yields the pictures of the views `numbers`, rendered by a farm, in the order in which they end; None if there is no news.

    The views are the frames of one job, or of several for many views: they follow each other, and one whose views are written
    is deleted after the next one has begun, as the films of all would take much of the farm's disk. Jobs that an interrupted run
    has left are taken up again. Raises ClientError, after all other pictures, if frames failed.
    """
    from rayfarm.client import ClientError

    jobs = _Jobs(request, scene, farm, folder, numbers)
    failures, begun = dict[int, str](), time.monotonic()
    while (current := jobs.current()) is not None:
        job, views, left = current
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
                    else:
                        data = farm.image(job, request.picture_format, number)
                        yield RenderedView(number, data, farm.digest(job, number))
                    if len(left) <= NEXT_JOB_AT:
                        jobs.submit_next()
            if left and found.is_over:
                why = f"failed: {found.error or 'no reason given'}" if found.state == "failed" else f"was {found.state}"
                raise ClientError(f"The job {job} {why}")
            if left:
                yield None
                time.sleep(min(POLL_S * (1.0 + (time.monotonic() - begun) / POLLS_GROW_IN_S), LONGEST_POLL_S))
        jobs.end(job, is_complete=not failures.keys() & {*views})
    if failures:
        number, why = next(iter(sorted(failures.items())))
        raise ClientError(f"{len(failures)} of {len(numbers)} views failed, the first is {number}: {why}")


class _Jobs:
    """The jobs of a data set on a farm: those of an interrupted run first, then new ones, at most two at a time."""

    def __init__(self, request: Request, scene: Path, farm: Client, folder: Folder, numbers: Sequence[int]) -> None:
        self._request, self._scene, self._farm, self._folder = request, scene, farm, folder
        self._wanted = {*numbers}
        self._jobs = _unfinished_jobs(farm, folder, numbers)  # views by job
        taken = {number for views in self._jobs.values() for number in views}
        self._left = sorted(self._wanted - taken)
        self._body: dict[str, Any] | None = None  # of a request, once the scene is uploaded
        self._open = list(self._jobs)

    def current(self) -> tuple[str, list[int], set[int]] | None:
        """Returns the job whose views come next, its views, ascending, and those that are missing; None if all have ended."""
        if not self._open:
            self._submit()
        if not self._open:
            return None
        job = self._open[0]
        return job, self._jobs[job], self._wanted & {*self._jobs[job]}

    def submit_next(self) -> None:
        """Submits the next job, unless one besides the current one is open already."""
        if len(self._open) < 2:
            self._submit()

    def end(self, job: str, is_complete: bool) -> None:
        """Removes a job all of whose views have ended. is_complete: whether it may be deleted, if another one follows it."""
        from rayfarm.client import ClientError

        self._open.remove(job)
        if is_complete and self._open:
            self._jobs.pop(job)
            self._folder.remember_jobs(self._farm.url, self._jobs)
            with suppress(ClientError):  # a farm that does not permit it keeps the job
                self._farm.delete(job)

    def _submit(self) -> None:
        part, self._left = self._left[:VIEWS_PER_JOB], self._left[VIEWS_PER_JOB:]
        if not part:
            return
        body = self._body = self._body or _job_body(self._request, self._scene, self._farm)
        views = [_view_json(self._request.views[number]) for number in part]
        job = self._farm.submit(**{**body, "views": views, "frames": frames_text(part)})
        self._jobs[job.id] = part
        self._open.append(job.id)
        self._folder.remember_jobs(self._farm.url, self._jobs)


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


def _job_body(request: Request, scene: Path, farm: Client) -> dict[str, Any]:
    """Uploads the scene, and returns what the requests of all jobs have in common."""
    from rayfarm.library.farm_render import job_request

    placement = request.arguments.picture.placement()._asdict()
    uploaded = farm.upload(scene_files(scene, request.vary), name=scene.stem, **placement)
    ready = farm.wait_for_scene(uploaded.id)
    body = job_request(farm, ready, request.arguments)
    body.pop("view", None)  # `height` in pixels is also the name of an orthographic view's
    if request.vary is not None:
        body["vary"] = request.vary
    elif vary_of_scene(scene) is not None:
        body["vary"] = False
    return {**body, "scene": ready.id}


def _view_json(view: View) -> dict[str, Any]:
    """Returns a view as a request has it, without settings that have their default."""
    usual = View((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    return {name: value for name, value in view.to_json().items() if name in ("eye", "target") or value != getattr(usual, name)}


def _moment(request: Request, number: int) -> Moment:
    return Moment(float(number), request.arguments.moment.fps, request.arguments.moment.clip)
