"""Denoised frames of a job, which workers make on request: alone, or as part of a shot."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from functools import partial

from anyio.to_thread import run_sync

from protocol.contract import VERSION_SEPARATOR, GuideScene
from renderer.errors import SettingsError
from renderer.frames import DENOISED_REACH, frame_key, frame_number
from renderer.sentences import Sentence
from renderer.settings import group_names
from service.errors import Conflict, FarmError, Invalid
from service.farm import Farm
from service.jobs.describe_frames import frame_numbers
from service.jobs.frame_scene import frame_scene
from service.jobs.motion import vectors_artifact
from service.scheduling.artifacts.artifact_result import ArtifactResult
from service.store.films import Film
from service.store.models import FINAL_STATES, Frame, Job, Scene

__all__ = ["denoised_artifact", "denoised_lights_artifact"]

MAX_LIGHTS_BYTES = 512 << 20
MAX_REST_S = 10.0  # seconds that a request waits for the next preview at most; otherwise it receives the latest one

_ATTEMPTS = 2


async def denoised_artifact(
    job: Job, n: float, film: Film, farm: Farm, *, in_shot: bool = False, is_preview: bool = False, waits: bool = True
) -> ArtifactResult:
    """Returns a denoised frame once a worker has made it. Occupies no thread meanwhile, since many clients may wait.

    in_shot: averages it with its finished neighbours along their motion vectors. It is denoised alone if it has none, or if the
    vectors cannot be made. is_preview: the latest preview, unless the frame itself is stored already. waits: for a
    better preview that is due; otherwise raises Conflict if there is none. Raises FarmError.
    """
    key = frame_key(n)
    if is_preview:
        find_stored = partial(farm.engine.denoised, job.id, key, film)
        if (stored := await run_sync(find_stored)) is not None:
            return stored
        if not waits:
            existing = await run_sync(farm.engine.existing_preview, job.id, key, film)
            if existing is None:
                raise Conflict(Sentence("no-preview-yet", "wait: no denoised preview has been made yet; leave wait out."))
            return replace(existing, is_preview=True)
        rest_s = 0.0 if job.state in FINAL_STATES else await run_sync(farm.engine.preview_rest_s, job.id, key, film)
        if 0.0 < rest_s <= MAX_REST_S:
            await asyncio.sleep(rest_s)
            if (stored := await run_sync(find_stored)) is not None:  # the job has ended meanwhile
                return stored
        request = partial(farm.engine.denoise_preview, job.id, key, film, is_final=job.state in FINAL_STATES)
        preview = await asyncio.shield(asyncio.wrap_future(await run_sync(request)))
        if (stored := await run_sync(find_stored)) is None:
            return replace(preview, is_preview=True)
        await run_sync(farm.engine.release_preview, job.id, key)  # the frame was denoised meanwhile, and released none
        return stored
    frames = await _with_neighbours(job, n, film, farm) if in_shot else ()
    guide = None if frames else await run_sync(_guide, job, key, farm)
    for _ in range(_ATTEMPTS):
        made = await run_sync(farm.engine.denoise, job.id, key, film, frames, guide)
        # Shielded: a client that disconnects must not cancel the work for other clients.
        found = await asyncio.shield(asyncio.wrap_future(made))
        if (VERSION_SEPARATOR in found.version) == bool(frames):
            break  # otherwise it was requested by another client, in the other way
    await run_sync(farm.engine.release_preview, job.id, key)
    return found


async def denoised_lights_artifact(job: Job, n: float, film: Film, farm: Farm) -> ArtifactResult:
    """Returns the denoised light of a frame's light groups (DenoiseFrame.lights) once a worker has made it.

    Raises FarmError; Invalid if that has more than MAX_LIGHTS_BYTES bytes.
    """
    lights = group_names((job.settings or {}).get("light_groups", ""))
    if 12 * film.width * film.height * len(lights) > MAX_LIGHTS_BYTES:
        raise Invalid(
            Sentence(
                "denoise-lights-too-large",
                "denoise: {count} light groups of {width}×{height} pixels are too large to be denoised; leave denoise out.",
                count=len(lights),
                width=film.width,
                height=film.height,
            )
        )
    made = await run_sync(farm.engine.denoise_lights, job.id, frame_key(n), film, lights)
    return await asyncio.shield(asyncio.wrap_future(made))


def _guide(job: Job, key: int, farm: Farm) -> GuideScene | None:
    """Returns DenoiseFrame.guide for a frame; None if its scene was deleted, or is not compiled for workers that denoise."""
    kind = farm.engine.snapshot.roster.denoising_kind()
    with farm.sessions() as session:
        scene, row = session.get(Scene, job.compiled_scene_id), session.get(Frame, (job.id, key))
    if kind is None or scene is None or kind not in (scene.compiled or {}):
        return None
    try:
        found = frame_scene(job, scene, row, kind)
    except SettingsError:
        return None
    return GuideScene(kind, found.base, found.settings, found.moment, found.own) if found else None


async def _with_neighbours(job: Job, n: float, film: Film, farm: Farm) -> tuple[tuple[int, str], ...]:
    """Returns DenoiseFrame.frames for a frame; empty if it is denoised alone."""
    keys = await run_sync(_finished_around, job, frame_key(n), farm)
    if len(keys) < 2:
        return ()
    try:
        found = await asyncio.gather(*(vectors_artifact(job, frame_number(key), film, farm) for key in keys))
    except FarmError:
        return ()
    return tuple((key, vectors.sha256) for key, vectors in zip(keys, found, strict=True))


def _finished_around(job: Job, key: int, farm: Farm) -> list[int]:
    """Returns the keys of a frame of a shot and of its finished neighbours up to DENOISED_REACH away, without a gap, in order."""
    if job.shot is None:
        return [key]
    step = frame_key(1)
    near = [key + step * k for k in range(-DENOISED_REACH, DENOISED_REACH + 1)]
    with farm.sessions() as session:
        finished = {number for number, f in frame_numbers(job, session, farm.engine, near) if f.state == "finished"}
    found = [key]
    for way in (-step, step):
        for k in range(1, DENOISED_REACH + 1):
            if key + way * k not in finished:
                break
            found.append(key + way * k)
    return sorted(found)
