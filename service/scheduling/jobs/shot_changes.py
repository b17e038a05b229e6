"""Changes of a shot that a user requests, translated into steps for its frames."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from typing import NamedTuple

from renderer.frames import MAX_FRAMES, frame_key, frame_number, frame_text, frames_text, parse_frames
from renderer.sentences import Sentence
from renderer.settings import MAX_SPP
from service.errors import Conflict, Invalid
from service.shot import Shot
from service.store.frame_changes import Step
from service.store.models import FINAL_STATES, Job

__all__ = [
    "NO_SAMPLES_FIRST",
    "CurrentFrame",
    "ShotRequest",
    "added_samples",
    "change_shot",
    "check_one_goal",
    "requested_spp",
    "samples_of",
]

NO_SAMPLES_FIRST = -1.0
NOISIEST_FIRST = "noisiest-first"


@dataclass(frozen=True)
class ShotRequest:
    """The fields of service.models.jobs.JobPatch that concern a shot. Sets of frames are texts, such as "10-20" or "7,9"."""

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
        """Returns True if the request cannot be applied without the database rows of the frames."""
        return self.state == "running" or not self.is_about_failures

    @property
    def is_about_failures(self) -> bool:
        """Returns True if the request concerns only failed frames."""
        return replace(self, state=None) == ShotRequest()


class CurrentFrame(NamedTuple):
    """The required columns of a frame's database row. spp: samples per pixel; None if the frame uses the job's."""

    spp: int | None
    state: str


def change_shot(job: Job, shot: Shot, frames: Mapping[int, CurrentFrame], request: ShotRequest) -> list[Step]:
    """Applies a request to a job's row, and returns the steps for its frames.

    frames: all frames of the shot by key; may be empty if not `request.is_about_frames`. Raises Invalid and Conflict; then
    discard the changed row.
    """
    now, steps = shot, list[Step]()
    if request.first is not None:
        now = replace(
            now, first=None if request.first == NO_SAMPLES_FIRST else _existing_keys(frames, [request.first], "first")[0]
        )
    if request.order is not None and request.order != now.order:
        now = now.with_changes(order=request.order)
        if NOISIEST_FIRST in (request.order, shot.order):
            steps.append(Step.for_keys("unplan", list(frames)))
    added = _added_frame_keys(frames, request)
    if added:
        steps.append(Step.for_keys("add", added, target=samples_of(job)))
    anew = _existing_keys(frames, parse_frames(request.again), "again") if request.again is not None else []
    if anew:
        steps.append(Step.for_keys("again", anew, unplan=now.order == NOISIEST_FIRST))
    failed = {key for key, frame in frames.items() if frame.state == "failed"}.difference(anew)
    aims, is_more = _sample_steps(job, now, frames, added, failed, request)
    healed = sorted(failed) if request.state == "running" else []
    if healed:
        aims.append(Step.for_keys("heal", healed))
    if added or anew or is_more or healed:
        named = dict.fromkeys((*now.anew_keys, *anew))
        known = now.frames if not added or now.frames is None else frames_text(map(frame_number, (*frames, *added)))
        now = now.with_changes(anew=frames_text(map(frame_number, named)), frames=known)
        if job.state in FINAL_STATES and job.state != "cancelled":
            job.state, job.finished, job.error, job.reproduce = "queued", None, None, None
    if now != shot:
        job.shot = now.to_json()
    return steps + aims


def samples_of(job: Job) -> int:
    """Returns the number of samples of one frame at the job's spp, over all pixels; 0 if unknown.

    A job with a noise or time goal may need fewer.
    """
    size = job.settings or job.request
    return int(size.get("width") or 0) * int(size.get("height") or 0) * (job.spp or 0)


def added_samples(job: Job, frames: Mapping[int, CurrentFrame], spp_before: int | None, steps: Iterable[Step]) -> int:
    """Returns the number of samples, over all pixels, that these steps add to a job.

    job: the row after the steps. frames: the frames before the steps, by key. spp_before: the job's samples per pixel before
    them.
    """
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


def check_one_goal(spp: int | None, more: int | None) -> None:
    """Raises Invalid if both a total and an addition are given."""
    if spp is not None and more is not None:
        raise Invalid(Sentence("spp-and-more-given", "spp: give either spp (the total per pixel) or more (additional samples)."))


def requested_spp(now: int, spp: int | None, more: int | None) -> int:
    """Returns the requested samples per pixel: `spp` in total, or `more` than now. Raises Invalid if they are too many."""
    wanted = spp if spp is not None else now + (more or 0)
    if wanted > MAX_SPP:
        raise Invalid(
            Sentence(
                "more-spp-too-high",
                "more: that makes {spp} samples per pixel; at most {most} are allowed.",
                spp=wanted,
                most=MAX_SPP,
            )
        )
    return wanted


def _added_frame_keys(frames: Mapping[int, CurrentFrame], request: ShotRequest) -> list[int]:
    if request.extend is None:
        return []
    keys = [key for key in map(frame_key, parse_frames(request.extend)) if key not in frames]
    if len(frames) + len(keys) > MAX_FRAMES:
        raise Invalid(
            Sentence(
                "shot-frames-too-many",
                "extend: the shot would have more than {most} frames. Make another job for the rest.",
                most=MAX_FRAMES,
            )
        )
    return keys


def _sample_steps(
    job: Job, shot: Shot, frames: Mapping[int, CurrentFrame], added: Sequence[int], failed: Set[int], request: ShotRequest
) -> tuple[list[Step], bool]:
    """Returns the steps that set the frames' samples, and whether any frame will be rendered.

    added: keys of the frames that the request adds. failed: keys of the frames that stay failed unless the request renders
    them.
    """
    if request.spp is None and request.more is None:
        if request.frames is not None:
            raise Invalid(
                Sentence(
                    "shot-frames-without-change",
                    "frames: give spp or more for these frames. Use `again` to render frames anew and `extend` for new ones.",
                )
            )
        return [], False
    check_one_goal(request.spp, request.more)
    if request.frames is not None and shot.order == NOISIEST_FIRST:
        raise Conflict(
            Sentence(
                "shot-spp-with-noisiest",
                "frames: the order noisiest chooses the samples of each frame. Give spp for the shot, or choose another order.",
            )
        )
    if request.frames is None:
        job.spp = _raised_goal(
            job.spp if job.noise is None and job.seconds is None else None, request, Sentence("label-shot", "the shot")
        )
        job.noise = job.seconds = None
        return [Step.for_keys("aim", [*frames, *added], keep=shot.order == NOISIEST_FIRST)], len(failed) < len(frames)
    chosen = _existing_keys(frames, parse_frames(request.frames), "frames")
    for key in chosen:
        _raised_goal(
            frames[key].spp or job.spp,
            request,
            Sentence("label-frame", "frame {frame}", frame=frame_text(frame_number(key))),
        )
    return [Step.for_keys("more", chosen, spp=request.spp, more=request.more)], not failed >= set(chosen)


def _raised_goal(now: int | None, request: ShotRequest, what: str) -> int:
    if now is None and request.spp is None:
        raise Conflict(
            Sentence(
                "shot-more-spp-unknown",
                "The number of samples of {what} is not known in advance, since a limit of noise or time ends it; more "
                "cannot be added to it. Give spp.",
                what=what,
            )
        )
    wanted = requested_spp(now or 0, request.spp, request.more)
    if now is not None and wanted < now:
        raise Conflict(
            Sentence(
                "shot-spp-lowered",
                "spp: {what} has {spp} samples per pixel already; samples can only be added.",
                what=what,
                spp=now,
            )
        )
    return wanted


def _existing_keys(frames: Mapping[int, CurrentFrame], numbers: Iterable[float], field: str) -> list[int]:
    keys = [frame_key(number) for number in numbers if float(2 * number).is_integer() and number >= 0]
    missing = [frame_number(key) for key in keys if key not in frames]
    if missing or not keys:
        has = frames_text([frame_number(key) for key in frames])
        raise Invalid(
            Sentence(
                "shot-frame-not-found",
                "{field}: the shot has no frame {frames}; it has {available}.",
                field=field,
                frames=frames_text(missing)[:200] or "-",
                available=has[:200],
            )
        )
    return keys
