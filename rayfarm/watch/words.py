"""Text about a job's progress: below its picture, and as lines."""

from __future__ import annotations

import math

from rich.cells import cell_len, set_cell_size

from rayfarm.responses import Frame, Job
from renderer.printable import one_line

__all__ = ["fit_columns", "format_count", "frame_title", "progress_text"]

BAR_WIDTH = 24  # cells
# Durations below a number of seconds, the step to which they are rounded, and their unit.
ESTIMATES = (
    (60, 5, "s", 1),
    (120, 10, "s", 1),
    (1200, 60, "min", 60),
    (5400, 300, "min", 60),
    (129_600, 3600, "h", 3600),
    (math.inf, 86_400, "d", 86_400),
)
EIGHTHS = " ▏▎▍▌▋▊▉█"


def progress_text(job: Job, with_bar: bool = False) -> str:
    """Returns a job's state, progress, rate and remaining time: `rendering · 43 % · 12.3 M samples/s · about 70 s left`."""
    done = f"{100 * job.progress:.0f} %"
    parts = [job.message or job.state, f"{_bar(job.progress)} {done}" if with_bar else done]
    if job.samples_per_s and not job.is_over:
        parts.append(f"{format_count(job.samples_per_s)} samples/s")
    if job.eta_s is not None and not job.is_over:
        parts.append(f"{_format_estimate(job.eta_s)} left")
    elif elapsed_s := max(job.active_s, job.elapsed_s):
        parts.append(f"{_format_duration(elapsed_s)}")
    return " · ".join(parts)


def frame_title(job: Job, frame: Frame | None) -> str:
    """Returns a job's name, size and quality: `milk truck · 1920x1080 · frame 7 · 64 of 512 spp · noise 2.1 %`."""
    parts = [one_line(job.name or job.id)]
    if job.width and job.height:
        parts.append(f"{job.width}x{job.height}")
    if frame is not None:
        if job.shot is not None:
            parts.append(f"frame {frame.number:g} of {job.shot.frames}")
        samples = f"{frame.spp:.3g}" if frame.spp < 10 else f"{frame.spp:.0f}"
        parts.append(f"{samples} of {job.spp} spp" if job.spp else f"{samples} spp")
        if frame.noise is not None:
            parts.append(f"noise {100 * frame.noise:.2g} %")
        if frame.error:
            parts.append(one_line(frame.error))
    return " · ".join(parts)


def fit_columns(text: str, columns: int) -> str:
    """Returns a line truncated or padded to this many columns."""
    clean = one_line(text)
    if cell_len(clean) > columns > 1:
        clean = f"{set_cell_size(clean, columns - 1).rstrip()}…"
    return set_cell_size(clean, columns)


def _bar(progress: float) -> str:
    eighths = round(8 * BAR_WIDTH * min(max(progress, 0.0), 1.0))
    full, rest = divmod(eighths, 8)
    return f"▕{('█' * full + (EIGHTHS[rest] if full < BAR_WIDTH else '')).ljust(BAR_WIDTH)}▏"


def format_count(number: float) -> str:
    """Returns a number with three digits and a letter for its size: `12.3 M`."""
    for size, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if number >= size:
            return f"{number / size:.3g} {letter}"
    return f"{number:.3g}"


def _format_estimate(seconds: float) -> str:
    """Returns an estimated duration, rounded as on the page (web/js/news/time-left.js): `about 15 s`."""
    _, step, unit, size = next(each for each in ESTIMATES if seconds < each[0])
    return f"about {max(round(seconds / step), 1) * step / size:.3g} {unit}"


def _format_duration(seconds: float) -> str:
    minutes, left = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{left:02}" if hours else f"{minutes}:{left:02}"
