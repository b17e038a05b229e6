"""A shot rendered by a farm: the requested frames, and the files to which they are written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rayfarm import options
from rayfarm.client import Client, ClientError
from rayfarm.console import PROGRAM, PlainProgress, bar, err
from rayfarm.errors import CommandError
from rayfarm.output_files import check_writable, write
from rayfarm.responses import Frame, Job
from renderer.frames import DENOISED_REACH, frame_name, frame_text, frames_text, parse_frames
from service.watching.movie import is_movie

__all__ = ["FarmShot", "fetch_shot", "look_of_file"]


@dataclass(frozen=True)
class FarmShot:
    """The requested frames of a scene, and their files.

    frames: those to render. all_frames: all requested frames, including those whose files exist already.
    """

    all_frames: list[float]
    frames: list[float]
    request: dict[str, Any]
    output: Path | None
    aov: str | None
    denoise: bool
    look: Mapping[str, Any]  # exposure and tone curve of the files; only those that are given

    @classmethod
    def from_options(
        cls,
        frames: str | None,
        frame: float | None,
        options: dict[str, Any],
        output: Path | None,
        aov: str | None,
        denoise: bool,
        overwrite: bool,
        look: Mapping[str, Any],
    ) -> FarmShot | None:
        """Returns the shot from command line options; None for a still image of the scene's start.

        options: fps, clip, turntable etc.; None if not given. look: as the attribute. Raises CommandError if the file names are
        not distinct, or the files cannot be written.
        """
        request = {name: value for name, value in options.items() if value is not None}
        if frames is None and frame is None and not request:
            return None
        if frames is not None and frame is not None:
            raise CommandError("--frame and --frames were both given; --frames 7,9-12 names any of them")
        numbers = parse_frames(frames) if frames is not None else [frame or 0.0]
        shot = cls(numbers, numbers, request, output, aov, denoise, look)
        if output is None:
            return shot
        if len(numbers) > 1 and not is_movie(output) and "#" not in output.name:
            example = f"{output.stem}.####{output.suffix}"
            raise CommandError(
                f"-o names one file, and there are {len(numbers)} frames. Write #### for their numbers: -o {example}, or a film: "
                f"-o {output.stem}.mp4"
            )
        check_writable(shot.file(numbers[0]))
        if is_movie(output) or frames is None or overwrite:
            return shot
        return cls(numbers, [n for n in numbers if not all(map(_is_there, shot.files(n)))], request, output, aov, denoise, look)

    def file(self, frame: float) -> Path:
        """Returns the path of a frame's file."""
        assert self.output is not None
        return self.output.with_name(frame_name(self.output.name, frame))

    def files(self, frame: float) -> list[Path]:
        """Returns the paths of a frame's files: its picture and, if requested, the denoised one."""
        return [self.file(frame), options.denoised_name(self.file(frame))] if self.denoise else [self.file(frame)]


def fetch_shot(farm: Client, job: str, shot: FarmShot) -> Job:
    """Waits for a shot and writes each frame once it is finished, and the movie, if requested, at the end.

    Returns the finished job. Raises ClientError; and CommandError if frames failed, after the other frames are written.
    """
    ticker, fetched, clean = PlainProgress(), set[float](), set[float]()
    writes_frames = shot.output is not None and not is_movie(shot.output)

    def fetch_finished(state: Job, frames: list[Frame]) -> None:
        for frame in frames:
            if writes_frames and frame.state == "finished" and frame.number not in fetched:
                _fetch(farm, state, shot, frame)
                fetched.add(frame.number)
        if writes_frames and shot.denoise:
            unfinished = {frame.number for frame in frames if frame.state not in ("finished", "failed")}
            for number in sorted(fetched - clean):
                if state.is_over or not any(number + k in unfinished for k in range(-DENOISED_REACH, DENOISED_REACH + 1)):
                    _fetch_denoised(farm, state, shot, number)
                    clean.add(number)

    with bar("frames") as progress:
        task = progress.add_task("rendering", total=len(shot.frames))

        def show_progress(state: Job) -> None:
            try:
                frames = farm.frames(job)
                fetch_finished(state, frames)
            except ClientError as error:
                if error.status is not None and error.status < 500:
                    raise
                return  # retried later
            finished = sum(frame.state == "finished" for frame in frames)
            so_far = sum(frame.progress for frame in frames if frame.state != "failed")
            progress.update(task, description=state.message or state.state, completed=so_far)
            ticker.print_if_due(f"{state.message or state.state}: {finished} of {len(frames)} frames")

        state = farm.wait(job, watch=show_progress)
    frames = farm.frames(job)
    fetch_finished(state, frames)
    done = sum(frame.state == "finished" for frame in frames)
    if shot.output is not None and not writes_frames and done:
        write(shot.output, farm.movie(job, shot.output.suffix.lower().lstrip("."), **shot.look))
        err.print(f"{shot.output} written, of {done} frames", markup=False, soft_wrap=True)
    elif writes_frames:
        err.print(f"{done} frames written", markup=False, soft_wrap=True)
    _raise_if_failed(job, frames)
    return state


def _raise_if_failed(job: str, frames: list[Frame]) -> None:
    failed = [frame for frame in frames if frame.state == "failed"]
    if not failed:
        return
    for why, number in {frame.error: frame.number for frame in reversed(failed)}.items():  # each reason once
        err.print(f"frame {frame_text(number)} failed: {why}", markup=False, soft_wrap=True)
    named = frames_text([frame.number for frame in failed])
    raise CommandError(f"{len(failed)} of {len(frames)} frames failed: {named}. `{PROGRAM} jobs {job}` shows more.")


def _fetch(farm: Client, job: Job, shot: FarmShot, frame: Frame) -> None:
    path = shot.file(frame.number)
    format = path.suffix.lower().lstrip(".").replace("jpeg", "jpg")
    if (job.settings or {}).get("deep"):  # before the picture: a run that continues fetches frames without one
        write(options.deep_name(path), farm.deep_image(job.id, frame.number))
    look = look_of_file(shot.look, format)
    write(path, farm.image(job.id, format, frame.number, aov=f"color,{shot.aov}" if shot.aov else "color", **look))


def _fetch_denoised(farm: Client, job: Job, shot: FarmShot, frame: float) -> None:
    path = shot.file(frame)
    format = path.suffix.lower().lstrip(".").replace("jpeg", "jpg")
    write(
        options.denoised_name(path),
        farm.image(job.id, format, frame, denoise=True, in_shot=True, **look_of_file(shot.look, format)),
    )


def look_of_file(look: Mapping[str, Any], format: str) -> dict[str, Any]:
    """Returns the part of `look` that applies to a picture's format: exposure and tone curve, neither in linear formats."""
    if format in ("exr", "hdr"):
        return {}
    return {name: value for name, value in look.items() if name == "exposure" or format in ("png", "jpg")}


def _is_there(path: Path) -> bool:
    return path.is_file() and path.stat().st_size > 0
