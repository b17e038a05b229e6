"""Motion vectors of a job's frames, which workers compute on request."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from functools import partial
from typing import BinaryIO

from anyio.to_thread import run_sync

from protocol.contract import FrameVectors
from renderer.frames import frame_key
from renderer.sentences import Sentence
from service.errors import Conflict
from service.farm import Farm
from service.intake.frame_view import requested_view
from service.scheduling.artifacts.artifact_result import ArtifactResult
from service.shot import Shot, variation_of
from service.store.films import Film
from service.store.models import Job, Scene

__all__ = ["motion_vectors_of", "vectors_artifact"]


async def motion_vectors_of(job: Job, n: float, film: Film, farm: Farm) -> Callable[[], BinaryIO]:
    """Returns a function that opens the file with a frame's motion vectors.

    First waits for a worker to compute them, without occupying a thread. Raises Unavailable if no worker can compute them, and
    the worker's error if it failed.
    """
    found = await vectors_artifact(job, n, film, farm)
    return partial(farm.blobs.open, found.sha256)


async def vectors_artifact(job: Job, n: float, film: Film, farm: Farm) -> ArtifactResult:
    """Returns a frame's motion vectors once a worker has computed them. Raises as `motion_vectors_of` does."""
    wish = await run_sync(_vectors_request, job, n, film, farm)
    made = await run_sync(farm.engine.vectors, wish)
    # Shielded: a client that disconnects must not cancel the work for other clients.
    return await asyncio.shield(asyncio.wrap_future(made))


def _vectors_request(job: Job, n: float, film: Film, farm: Farm) -> FrameVectors:
    with farm.sessions() as session:
        scene = session.get(Scene, job.scene)
    if scene is None or not scene.info:
        raise Conflict(Sentence("job-scene-preparing", "The job's scene is still being prepared. Try again later."))
    shot = Shot.parse(job.shot) or Shot()
    return FrameVectors(
        work="",
        job=job.id,
        frame=frame_key(n),
        scene=job.scene,
        width=film.width,
        height=film.height,
        auto=scene.info["cameras"][-1]["view"],
        fps=shot.fps,
        clip=shot.clip,
        camera=job.request.get("camera"),
        view=requested_view(job.request, n),
        turntable=shot.turntable,
        vary=variation_of(job.request, shot),
    )
