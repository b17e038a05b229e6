"""Renders frames in sequence, each to its own file. Skips frames whose files exist, and reports failures."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import timedelta
from functools import partial
from pathlib import Path
from typing import Any

from rayfarm import options
from rayfarm.console import bar, err
from rayfarm.errors import CommandError
from rayfarm.frame import PictureOrder, camera_options, moment_options, motion_of, render_to, report_bad_samples, statistics
from rayfarm.output_files import check_still_size, check_writable
from rayfarm.reading import ConfinedScene
from rayfarm.rendering import Clock, Show
from rayfarm.strict import refuse_warnings
from rayfarm.temporal_denoise import TemporalDenoiser
from renderer.errors import RayfarmError
from renderer.frames import frame_name, frame_text, frames_text
from renderer.scene.animation import Moment
from service.watching.movie import is_movie

__all__ = ["Sequence", "check_outputs", "render_sequence"]


@dataclass(frozen=True)
class Sequence:
    """The frames to render in sequence, and their files."""

    scene: Path
    frames: list[float]
    output: Path  # with #### in its name
    moment: Moment  # its frame is set later
    overwrite: bool = False
    files: Mapping[float, Path] | None = None  # by frame, if the names have other numbers than the frames

    def file(self, frame: float) -> Path:
        """Returns the path of a frame's file."""
        if self.files is not None:
            return self.files[frame]
        return self.output.with_name(frame_name(self.output.name, frame))


def check_outputs(shot: Sequence) -> None:
    """Raises CommandError if the frames' file names are not distinct, or if the files cannot be written."""
    if shot.files is None and len(shot.frames) > 1 and "#" not in shot.output.name and not is_movie(shot.output):
        example = f"{shot.output.stem}.####{shot.output.suffix}"
        raise CommandError(
            f"-o names one file, and there are {len(shot.frames)} frames. Write #### for their numbers: -o {example}; or name a "
            f"film: -o {shot.output.stem}.mp4"
        )
    check_writable(shot.file(shot.frames[0]))


def render_sequence(shot: Sequence, stage: ConfinedScene, order: PictureOrder) -> dict[str, Any]:
    """Renders the missing frames. Returns the statistics for --stats; `failed`: each failed frame with its error.

    Files are written under a temporary name and then renamed, so an existing file is complete.
    """
    missing = [f for f in shot.frames if shot.overwrite or not all(_is_there(p) for p in order.files(shot.file(f)))]
    kept = len(shot.frames) - len(missing)
    if kept:
        err.print(f"{kept} of {len(shot.frames)} frames are there and kept; --overwrite renders them again", markup=False)
    failed: dict[float, str] = {}
    statistic: list[dict[str, Any]] = []
    reported_errors: set[str] = set()
    steadying = TemporalDenoiser(shot.frames if order.denoise and order.tile is None else (), missing)
    todo = steadying.plan if order.denoise else missing

    def record_failure(frame: float, error: Exception) -> None:
        failed[frame] = str(error) or "the memory is full"
        progress.fail(frame, "" if failed[frame] in reported_errors else f": {failed[frame]}")
        reported_errors.add(failed[frame])

    with _Progress(len(todo)) as progress:
        for frame in todo:
            try:
                found = _render(shot, stage, order, frame, progress.begin(frame), reported_errors, steadying)
                if frame in steadying.missing:
                    statistic.append(found)
                progress.finish(str(shot.file(frame)))
            except (RayfarmError, OSError, MemoryError) as error:
                if isinstance(error, CommandError) and not statistic:
                    raise  # the error applies to every frame
                record_failure(frame, error)
            for neighbour, write in steadying.mark_done(frame):
                try:
                    write()
                except (RayfarmError, OSError, MemoryError) as error:
                    record_failure(neighbour, error)
    if failed:
        named = frames_text(list(failed))
        err.print(f"{len(failed)} of {len(shot.frames)} frames failed: {named}", markup=False, soft_wrap=True)
    return {"frames": statistic, "kept": kept, "failed": {frame_text(f): why for f, why in failed.items()}}


def _is_there(path: Path) -> bool:
    return path.is_file() and path.stat().st_size > 0


class _Progress:
    """Shows the progress of a sequence and its remaining time: as a bar, or a line for each frame."""

    def __init__(self, count: int) -> None:
        self._bar, self._count, self._done = bar("frames"), count, 0
        self._task = self._bar.add_task("rendering", total=count)
        self._began = time.monotonic()

    def __enter__(self) -> _Progress:
        self._bar.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self._bar.stop()
        if kind is KeyboardInterrupt:
            err.print(f"Stopped after {self._done} of {self._count} frames. The same command goes on from here.", markup=False)

    def begin(self, frame: float) -> Show:
        """Starts a frame; returns the function that shows its progress."""
        self._bar.update(self._task, description=f"frame {frame_text(frame)}")

        def show_progress(part: int, total: int) -> None:
            self._bar.update(self._task, completed=self._done + part / max(total, 1))

        return show_progress

    def finish(self, file: str) -> None:
        """Records that a frame was written."""
        self._advance()
        if not err.is_terminal:
            left = (time.monotonic() - self._began) / self._done * (self._count - self._done)
            err.print(
                f"{file} ({self._done} of {self._count}, {timedelta(seconds=round(left))} left)", markup=False, soft_wrap=True
            )

    def fail(self, frame: float, why: str) -> None:
        """Records that a frame failed."""
        self._advance()
        err.print(f"frame {frame_text(frame)} failed{why}", markup=False, soft_wrap=True)

    def _advance(self) -> None:
        self._done += 1
        self._bar.update(self._task, completed=self._done)


def _render(
    shot: Sequence,
    stage: ConfinedScene,
    order: PictureOrder,
    frame: float,
    show: Show,
    reported: set[str],
    steadying: TemporalDenoiser,
) -> dict[str, Any]:
    from renderer.render import settings_as_rendered, variant_for, warm_up

    clock = Clock()
    moment = replace(shot.moment, frame=frame)
    is_held = steadying.has_neighbours(frame)
    motion = motion_of(stage, order, moment, clock, needed=is_held)
    compiled, summary = stage.scene_at(moment)
    clock.end_step("prepare_s")
    warnings = options.relevant_warnings(summary["warnings"], order.picture.environment())
    refuse_warnings(f"{shot.scene.name}, frame {frame:g}", warnings, order.strict)
    for warning in [*warnings, *order.picture.floor_notes(summary["floor"])]:
        if warning not in reported:
            reported.add(warning)
            err.print(f"note: {warning}", markup=False, soft_wrap=True)
    settings = order.settings(summary, moment)
    check_still_size(shot.file(frame), settings.width, settings.height)
    warm_up(settings_as_rendered(settings, compiled), variant_for(settings, compiled), prepares=False)
    clock.end_step("compile_s")
    hold = partial(steadying.add_frame, frame) if is_held else None
    written = frame in steadying.missing
    done = render_to(shot.file(frame), order, compiled, summary, settings, clock, show, motion, hold, written)
    report_bad_samples(shot.scene, settings, done, moment_options(moment) + camera_options(order, settings))
    return {"frame": frame, "fps": summary["fps"], "file": str(shot.file(frame)), **statistics(clock, done)}
