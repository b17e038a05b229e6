"""What a person may change in a job of several frames, and what that does to its rows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from typing import NamedTuple

from renderer.frames import MAX_FRAMES, frame_key, frame_number, frame_text, frames_text, parse_frames
from renderer.settings import MAX_SPP
from service.errors import Conflict, Invalid
from service.shot import Shot
from service.store.frame_changes import Step
from service.store.models import FINAL, Job

__all__ = ["NONE_FIRST", "FrameNow", "ShotWish", "asked_for", "change_shot", "samples_of"]

NONE_FIRST = -1.0
NOISIEST = "noisiest-first"


@dataclass(frozen=True)
class ShotWish:
    """state, spp, more, and the rest: as service.models.jobs.JobPatch has them. Frames are written as 10-20 or 7,9."""

    state: str | None = None
    spp: int | None = None
    more: int | None = None
    frames: str | None = None
    extend: str | None = None
    again: str | None = None
    first: float | None = None
    order: str | None = None

    @property
    def is_about_frames(self) -> bool:
        """Whether it cannot be fulfilled without a look at the frames."""
        return self.state == "running" or not self.is_about_failures

    @property
    def is_about_failures(self) -> bool:
        """Whether no other frames matter to it than those that failed."""
        return replace(self, state=None) == ShotWish()


class FrameNow(NamedTuple):
    """What is known of a frame. spp: where it is to have others than the job."""

    spp: int | None
    state: str


def change_shot(job: Job, shot: Shot, frames: Mapping[int, FrameNow], wish: ShotWish) -> list[Step]:
    """Change a job; returns what is to be done to its frames. frames: all of them, by their keys, where the wish is about frames
    (`is_about_frames`). Raises Invalid and Conflict; then nothing may be kept of it.
    """
    now, steps = shot, list[Step]()
    if wish.first is not None:
        now = replace(now, first=None if wish.first == NONE_FIRST else _known(frames, [wish.first], "first")[0])
    if wish.order is not None and wish.order != now.order:
        now = now.changed(order=wish.order)
        if NOISIEST in (wish.order, shot.order):
            steps.append(Step.of("unplan", list(frames)))
    added = _added(frames, wish)
    if added:
        steps.append(Step.of("add", added, target=samples_of(job)))
    anew = _known(frames, parse_frames(wish.again), "again") if wish.again is not None else []
    if anew:
        steps.append(Step.of("again", anew, unplan=now.order == NOISIEST))
    failed = {key for key, frame in frames.items() if frame.state == "failed"}.difference(anew)
    aims, is_more = _ask_for_samples(job, now, frames, added, failed, wish)
    healed = sorted(failed) if wish.state == "running" else []
    if healed:
        aims.append(Step.of("heal", healed))
    if added or anew or is_more or healed:
        named = dict.fromkeys((*now.anew_keys, *anew))
        known = now.frames if not added or now.frames is None else frames_text(map(frame_number, (*frames, *added)))
        now = now.changed(anew=frames_text(map(frame_number, named)), frames=known)
        if job.state in FINAL and job.state != "cancelled":
            job.state, job.finished, job.error, job.reproduce = "queued", None, None, None
    if now != shot:
        job.shot = now.to_json()
    return steps + aims


def samples_of(job: Job) -> int:
    """As many as a job asks for in a frame, as far as that is known: one that ends by noise or time may have fewer."""
    size = job.settings or job.request
    return int(size.get("width") or 0) * int(size.get("height") or 0) * (job.spp or 0)


def asked_for(job: Job, frames: Mapping[int, FrameNow], spp_before: int | None, steps: Iterable[Step]) -> int:
    """How many samples steps have a job render that it was not asked for before. job: as it is after them."""
    per_frame, now = samples_of(job), job.spp or 0
    pixels = per_frame // now if now else 0
    samples = 0
    for step in steps:
        had = [(frames[key].spp if key in frames else None) or spp_before or 0 for key in step.keys]
        if step.do == "add":
            samples += len(had) * step.target
        elif step.do == "again":
            samples += len(had) * per_frame
        elif step.do == "aim":
            samples += sum(max(now - each, 0) for each in had) * pixels
        elif step.do == "more":
            samples += sum(max((step.spp or each + (step.more or 0)) - each, 0) for each in had) * pixels
    return samples


def _added(frames: Mapping[int, FrameNow], wish: ShotWish) -> list[int]:
    if wish.extend is None:
        return []
    keys = [key for key in map(frame_key, parse_frames(wish.extend)) if key not in frames]
    if len(frames) + len(keys) > MAX_FRAMES:
        raise Invalid(f"extend: the shot would have more than {MAX_FRAMES} frames. Make another job for the rest.")
    return keys


def _ask_for_samples(
    job: Job, shot: Shot, frames: Mapping[int, FrameNow], added: Sequence[int], failed: Set[int], wish: ShotWish
) -> tuple[list[Step], bool]:
    """From now on frames have so many samples in every pixel as their aim: what is to be done for that, and whether any is to be
    rendered. failed: those that are not."""
    if wish.spp is None and wish.more is None:
        if wish.frames is not None:
            raise Invalid("frames: say what of these frames: spp, or more. Those to render anew are `again`, new ones `extend`.")
        return [], False
    if wish.spp is not None and wish.more is not None:
        raise Invalid("spp: give either spp, for all samples of a pixel, or more, for those on top.")
    if wish.frames is not None and shot.order == NOISIEST:
        raise Conflict("frames: noisiest first lays out the samples by itself. Give spp for the shot, or choose another order.")
    if wish.frames is None:
        job.spp = _more(job.spp if job.noise is None and job.seconds is None else None, wish, "the shot")
        job.noise = job.seconds = None
        return [Step.of("aim", [*frames, *added], keep=shot.order == NOISIEST)], len(failed) < len(frames)
    chosen = _known(frames, parse_frames(wish.frames), "frames")
    for key in chosen:
        _more(frames[key].spp or job.spp, wish, f"frame {frame_text(frame_number(key))}")
    return [Step.of("more", chosen, spp=wish.spp, more=wish.more)], not failed >= set(chosen)


def _more(now: int | None, wish: ShotWish, what: str) -> int:
    if now is None and wish.spp is None:
        raise Conflict(f"more: how many samples {what} has is not known, as noise or time ends it. Give spp.")
    wanted = wish.spp if wish.spp is not None else (now or 0) + (wish.more or 0)
    if wanted > MAX_SPP:
        raise Invalid(f"more: that is {wanted} samples a pixel; at most {MAX_SPP} are rendered.")
    if now is not None and wanted < now:
        raise Conflict(f"spp: {what} has {now} samples a pixel already; samples are added, never taken away.")
    return wanted


def _known(frames: Mapping[int, FrameNow], numbers: Iterable[float], field: str) -> list[int]:
    keys = [frame_key(number) for number in numbers if float(2 * number).is_integer() and number >= 0]
    missing = [frame_number(key) for key in keys if key not in frames]
    if missing or not keys:
        has = frames_text([frame_number(key) for key in frames])
        raise Invalid(f"{field}: the shot has no frame {frames_text(missing)[:200] or '-'}; it has {has[:200]}.")
    return keys
