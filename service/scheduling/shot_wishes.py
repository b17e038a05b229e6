"""What a person may change in a job of several frames, and what that does to its rows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

from renderer.frames import MAX_FRAMES, frame_key, frame_number, frame_text, frames_text, parse_frames
from renderer.settings import MAX_SPP
from service.errors import Conflict, Invalid
from service.shot import Shot
from service.store.models import FINAL, Frame, Job

__all__ = ["NONE_FIRST", "ShotWish", "change_shot"]

NONE_FIRST = -1.0
NOISIEST = "noisiest-first"


@dataclass(frozen=True)
class ShotWish:
    """state, spp, more, and the rest: as service.api.schemas.JobPatch has them. Frames are written as 10-20 or 7,9."""

    state: str | None = None
    spp: int | None = None
    more: int | None = None
    frames: str | None = None
    extend: str | None = None
    again: str | None = None
    first: float | None = None
    order: str | None = None


def change_shot(job: Job, shot: Shot, frames: Mapping[int, Frame], wish: ShotWish) -> list[Frame]:
    """Change a job and its frames; returns those that are new. Raises Invalid and Conflict; then nothing may be kept of it."""
    now = shot
    if wish.first is not None:
        now = replace(now, first=None if wish.first == NONE_FIRST else _known(frames, [wish.first], "first")[0])
    if wish.order is not None and wish.order != now.order:
        now = now.changed(order=wish.order)
        for frame in frames.values():
            frame.spp = None if NOISIEST in (wish.order, shot.order) else frame.spp
    added = _added(job, frames, wish)
    anew = _known(frames, parse_frames(wish.again), "again") if wish.again is not None else []
    for key in anew:
        frame = frames[key]
        frame.samples = frame.target = frame.bad_samples = 0
        frame.progress, frame.noise, frame.settings, frame.compiled = 0.0, None, None, None
        frame.spp = None if now.order == NOISIEST else frame.spp
        _open(frame)
    more = _ask_for_samples(job, now, frames, wish)
    healed = [key for key, frame in frames.items() if wish.state == "running" and frame.state == "failed"]
    for key in (*more, *healed):
        _open(frames[key])
    for key in more:
        _aim_anew(job, frames[key])
    if added or anew or more or healed:
        now = now.changed(anew=[*now.anew, *(key for key in anew if key not in now.anew)])
        if job.state in FINAL and job.state != "cancelled":
            job.state, job.finished, job.error, job.reproduce = "queued", None, None, None
    if now != shot:
        job.shot = now.to_json()
    return added


def _added(job: Job, frames: Mapping[int, Frame], wish: ShotWish) -> list[Frame]:
    if wish.extend is None:
        return []
    keys = [key for key in map(frame_key, parse_frames(wish.extend)) if key not in frames]
    if len(frames) + len(keys) > MAX_FRAMES:
        raise Invalid(f"extend: the shot would have more than {MAX_FRAMES} frames. Make another job for the rest.")
    return [Frame(job=job.id, number=key, samples=0, target=0, bad_samples=0, progress=0.0, state="queued") for key in keys]


def _ask_for_samples(job: Job, shot: Shot, frames: Mapping[int, Frame], wish: ShotWish) -> list[int]:
    """From now on frames have so many samples in every pixel as their aim; the keys of those that are to be rendered."""
    if wish.spp is None and wish.more is None:
        if wish.frames is not None:
            raise Invalid("frames: say what of these frames: spp, or more. Those to render anew are `again`, new ones `extend`.")
        return []
    if wish.spp is not None and wish.more is not None:
        raise Invalid("spp: give either spp, for all samples of a pixel, or more, for those on top.")
    if wish.frames is not None and shot.order == NOISIEST:
        raise Conflict("frames: noisiest first lays out the samples by itself. Give spp for the shot, or choose another order.")
    if wish.frames is None:
        job.spp = _more(job.spp if job.noise is None and job.seconds is None else None, wish, "the shot")
        job.noise = job.seconds = None
        chosen = list(frames)
    else:
        chosen = _known(frames, parse_frames(wish.frames), "frames")
    raised = []
    for key in chosen:
        frame = frames[key]
        if wish.frames is not None:
            frame.spp = _more(frame.spp or job.spp, wish, f"frame {frame_text(frame_number(key))}")
        elif shot.order != NOISIEST:
            frame.spp = None if frame.spp is None or frame.spp <= (job.spp or 0) else frame.spp
        if frame.state != "failed":
            raised.append(key)
    return raised


def _more(now: int | None, wish: ShotWish, what: str) -> int:
    if now is None and wish.spp is None:
        raise Conflict(f"more: how many samples {what} has is not known, as noise or time ends it. Give spp.")
    wanted = wish.spp if wish.spp is not None else (now or 0) + (wish.more or 0)
    if wanted > MAX_SPP:
        raise Invalid(f"more: that is {wanted} samples a pixel; at most {MAX_SPP} are rendered.")
    if now is not None and wanted < now:
        raise Conflict(f"spp: {what} has {now} samples a pixel already; samples are added, never taken away.")
    return wanted


def _known(frames: Mapping[int, Frame], numbers: Iterable[float], field: str) -> list[int]:
    keys = [frame_key(number) for number in numbers if float(2 * number).is_integer() and number >= 0]
    missing = [frame_number(key) for key in keys if key not in frames]
    if missing or not keys:
        has = frames_text([frame_number(key) for key in frames])
        raise Invalid(f"{field}: the shot has no frame {frames_text(missing) or '-'}; it has {has[:200]}.")
    return keys


def _aim_anew(job: Job, frame: Frame) -> None:
    """What a frame has is a part of what it is to have now."""
    settings = job.settings or {}
    wanted = (frame.spp or job.spp or 0) * int(settings.get("width", 0)) * int(settings.get("height", 0))
    frame.target = max(wanted, frame.samples)
    frame.progress = min(frame.samples / frame.target, 0.9999) if frame.target else 0.0


def _open(frame: Frame) -> None:
    frame.state, frame.error = "queued", None
