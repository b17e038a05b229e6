"""Converts frames from database rows, with the engine's current numbers, to the API's models."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice
from typing import Any, cast

from pydantic_core import to_json
from sqlalchemy import select
from sqlalchemy.orm import Session

from protocol.reproduce import sample_command
from renderer.errors import SettingsError
from renderer.frames import frame_key, frame_number
from renderer.sentences import codes_of
from renderer.settings import RenderSettings
from service.errors import FarmError
from service.jobs.shot_sums import live_numbers
from service.models.jobs import BadSampleOut, FrameOut, FrameState
from service.scheduling.engine import Engine
from service.scheduling.jobs.active_frame import FrameNumbers
from service.scheduling.snapshot import JobNumbers
from service.store.models import ACTIVE_STATES, Frame, Job, Scene

__all__ = [
    "RECORDED",
    "Recorded",
    "bad_samples_of",
    "frame_numbers",
    "frame_out",
    "frames_json",
    "latest_frame_numbers",
    "one_frame",
    "plain_frames",
    "still_numbers",
]

MAX_BAD_SAMPLES = 16
Recorded = list[tuple[int, FrameNumbers]]  # frame keys and numbers of a job
RECORDED = FrameNumbers._fields  # columns of a frame's row


def still_numbers(job: Job, recorded: Iterable[tuple[int, FrameNumbers]], live: JobNumbers | None, is_live: bool) -> Recorded:
    """Returns the statistics of a still image's only frame (samples, noise, times), with a state derived from the job's.

    recorded: the statistics in the database. live: the engine's statistics, which replace them if they are newer. is_live:
    whether the job is being rendered.
    """
    state = job.state if job.state in ("running", "finished", "failed") else "queued"
    found = []
    for key, f in recorded:
        numbers = f._replace(state=state, error=None)
        # The engine stores its numbers once a second, and once more shortly after a cancellation: until then the
        # stored numbers of an ended job may be behind those sent to clients.
        if live is not None and (is_live or live.samples > f.samples):
            numbers = numbers._replace(samples=live.samples, bad_samples=live.bad_samples)
            numbers = numbers._replace(progress=live.progress, noise=live.noise)
        found.append((key, numbers))
    return found


def frame_numbers(
    job: Job, session: Session, engine: Engine, keys: Iterable[int] | None = None, page: tuple[int, int | None] = (0, None)
) -> Recorded:
    """Returns (key, numbers) pairs of a job's frames in order, with the engine's latest numbers.

    keys: only these frames. page: offset and maximum count (None: unlimited).
    """
    known = engine.snapshot.jobs.get(job.id)
    if live_numbers(job, known) is not None and known is not None:
        chosen = (
            known.frames.items() if keys is None else ((key, known.frames[key]) for key in sorted({*keys} & known.frames.keys()))
        )
        return list(islice(chosen, page[0], None if page[1] is None else page[0] + page[1]))
    columns = [getattr(Frame, name) for name in ("number", *RECORDED)]
    query = select(*columns).where(Frame.job == job.id).order_by(Frame.number).offset(page[0]).limit(page[1])
    if keys is not None:
        query = query.where(Frame.number.in_(list(keys)))
    rows = ((number, FrameNumbers._make(numbers)) for number, *numbers in session.execute(query))
    if job.shot is None:
        return still_numbers(job, rows, known, job.state in ACTIVE_STATES)
    return [(number, latest_frame_numbers(job, known, number, numbers)) for number, numbers in rows]


def frames_json(
    job: Job, session: Session, engine: Engine, state: str | None = None, page: tuple[int, int | None] = (0, None)
) -> bytes:
    """Returns the frames of a job as JSON. state: only frames in this state; None: all."""
    is_paged = state is None
    found = frame_numbers(job, session, engine, page=page if is_paged else (0, None))
    if state is not None:
        first, most = page
        found = [each for each in found if each[1].state == state][first : None if most is None else first + most]
    return to_json(plain_frames(job, found))


def plain_frames(job: Job, found: Recorded) -> list[dict[str, Any]]:
    """Returns the fields of FrameOut as plain dicts. Skips validation, which takes seconds for a hundred thousand frames."""
    size = job.settings or {}
    pixels = size.get("width", 1) * size.get("height", 1)
    return [
        {
            "number": frame_number(key),
            "state": n.state,
            "samples": n.samples,
            "spp": round(n.samples / pixels, 3),
            "bad_samples": n.bad_samples,
            "bad": [],
            "progress": n.progress,
            "noise": n.noise,
            "error": n.error,
            "codes": codes_of({"error": n.error}),
        }
        for key, n in found
    ]


def latest_frame_numbers(job: Job, live_numbers: JobNumbers | None, key: int, recorded: FrameNumbers) -> FrameNumbers:
    """Returns the newer statistics of a shot's frame: the engine's (`live_numbers`), or those in the database (`recorded`).

    For a job that has ended, the engine's are used only if they have more samples, as shortly after a cancellation.
    """
    live = live_numbers.frames.get(key) if live_numbers is not None else None
    if live is None or (job.state not in ACTIVE_STATES and live.samples <= recorded.samples):
        return recorded
    return live


def frame_out(job: Job, session: Session, engine: Engine, key: int) -> FrameOut | None:
    """Returns the API's model of a job's frame, with its first bad samples; None if the job has no such frame."""
    found = next((one_frame(job, *each) for each in frame_numbers(job, session, engine, [key]) if each[0] == key), None)
    if found is not None:
        found.bad = bad_samples_of(job, found, session, engine)
        found.denoised = engine.has_denoised(job.id, key, found.samples)
    return found


def one_frame(job: Job, key: int, numbers: FrameNumbers) -> FrameOut:
    """Returns the API's model of a frame from its numbers."""
    size = job.settings or {}
    return FrameOut(
        number=frame_number(key),
        state=cast(FrameState, numbers.state),
        samples=numbers.samples,
        spp=round(numbers.samples / (size.get("width", 1) * size.get("height", 1)), 3),
        bad_samples=numbers.bad_samples,
        bad=[],
        progress=numbers.progress,
        noise=numbers.noise,
        error=numbers.error,
        denoised=False,
    )


def bad_samples_of(job: Job, frame: FrameOut, session: Session, engine: Engine) -> list[BadSampleOut]:
    """Returns the first samples of a frame that were discarded because they were NaN or infinite."""
    if not frame.bad_samples or job.settings is None or job.tile_size is None:
        return []
    try:
        settings = RenderSettings.from_json(job.settings)
        bad = engine.films.open(job.id, settings, job.tile_size).bad_samples(frame_key(frame.number))[1]
    except (FarmError, SettingsError):
        return []  # being deleted, or film broken or of another release: see the job's error
    reading = _scene_options(job, session) if bad else []
    return [BadSampleOut(**b._asdict(), reproduce=sample_command(settings, *b, reading)) for b in bad[:MAX_BAD_SAMPLES]]


def _scene_options(job: Job, session: Session) -> list[str]:
    """Returns the options of `rayfarm render` with which it reads the scene as the job does."""
    scene = session.get(Scene, job.compiled_scene_id)
    if scene is None:
        return []
    has_floor = scene.floor == "on" or (scene.floor is not None and bool((scene.info or {}).get("floor")))
    axis = [] if scene.up is None else [f"--up-axis={scene.up}"]
    return [*axis, "--floor" if has_floor else "--no-floor"]
