"""Parses and formats frame ranges, and the file names of frames."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from functools import lru_cache

from renderer.errors import SettingsError
from renderer.sentences import Sentence

__all__ = [
    "DENOISED_REACH",
    "MAX_FRAME",
    "MAX_FRAMES",
    "equal_steps",
    "frame_key",
    "frame_name",
    "frame_number",
    "frame_text",
    "frames_text",
    "numbers_of",
    "parse_frames",
]

MAX_FRAMES = 100_000
MOST_RUNS = 200  # runs written in full
MOST_NAMED = 2 * MAX_FRAMES  # including repeated ones
MAX_FRAME = 10_000_000
DENOISED_REACH = 2  # frames before and after one with which temporal denoising averages it
_NUMBER = r"(\d{1,8}(?:\.[05])?)"
_RANGE_PATTERN = re.compile(rf"{_NUMBER}(?:-{_NUMBER}(?:[x:]{_NUMBER})?)?")


def parse_frames(text: str) -> list[float]:
    """Returns the frame numbers in a text such as `0-99`, `7`, `1-250x5,300` or `0-10x0.5`, in order, without duplicates.

    `1-250x5` is every fifth frame. Raises SettingsError if the text is invalid.
    """
    return list(_parse(text))


@lru_cache(4)  # several parts of a request parse it
def _parse(text: str) -> tuple[float, ...]:
    found: dict[float, None] = {}
    named = 0
    for part in text.replace(" ", "").split(","):
        match = _RANGE_PATTERN.fullmatch(part)
        if match is None:
            raise SettingsError(
                Sentence(
                    "frames-malformed",
                    "frames is {text}; give numbers and ranges such as 0-99 or 1-250x5,300",
                    text=repr(text[:80]),
                )
            )
        first, last, step = (float(number) if number is not None else None for number in match.groups())
        first = first or 0.0
        last = first if last is None else last
        step = 1.0 if step is None else step
        if last < first:
            raise SettingsError(
                Sentence(
                    "frames-range-reversed",
                    "frames is {text}; the range {part} ends before it begins",
                    text=repr(text[:80]),
                    part=part,
                )
            )
        if step == 0 or last > MAX_FRAME:
            raise SettingsError(
                Sentence(
                    "frames-range-too-large",
                    "frames is {text}; ranges end at {max_frame} at most and have steps of at least 0.5",
                    text=repr(text[:80]),
                    max_frame=MAX_FRAME,
                )
            )
        count = int((last - first) / step) + 1
        named += count
        if len(found) + count > MAX_FRAMES or named > MOST_NAMED:
            raise SettingsError(
                Sentence(
                    "frames-too-many",
                    "frames is {text}; that is more than {max_frames} frames. Split them into several jobs",
                    text=repr(text[:80]),
                    max_frames=MAX_FRAMES,
                )
            )
        found |= dict.fromkeys(first + step * i for i in range(count))
    return tuple(found)


def frame_key(frame: float) -> int:
    """Returns a frame number in units of half a frame, as films and messages store it: 12.5 becomes 25."""
    return round(2 * frame)


def frame_number(key: int) -> float:
    """Returns the frame number of a `frame_key`; an int for whole frames."""
    return key // 2 if key % 2 == 0 else key / 2


def frame_text(frame: float) -> str:
    """Returns a frame number as text, with .5 for half frames."""
    return f"{frame:g}" if frame < 1e5 else f"{frame:.1f}".removesuffix(".0")


def frames_text(frames: Iterable[float]) -> str:
    """Returns frame numbers as short text: consecutive integers as ranges; if that is long, also runs with equal steps."""
    numbers = sorted(frames)
    runs: list[list[float]] = []
    for frame in numbers:
        if runs and frame == runs[-1][1] + 1:
            runs[-1][1] = frame
        else:
            runs.append([frame, frame])
    if len(runs) <= MOST_RUNS:
        return ",".join(_run_text(a, b) for a, b in runs)
    return ",".join(_run_text(*run) for run in equal_steps(numbers))


def _run_text(first: float, last: float, step: float = 1) -> str:
    if first == last:
        return frame_text(first)
    return f"{frame_text(first)}-{frame_text(last)}{f'x{frame_text(step)}' if step != 1 else ''}"


def equal_steps(numbers: list[float]) -> Iterator[tuple[float, float, float]]:
    """Yields (first, last, step) for each run of at least three numbers with equal steps, and (n, n, 1) for other numbers."""
    at = 0
    while at < len(numbers):
        end = at + 1
        step = numbers[end] - numbers[at] if end < len(numbers) else 1
        while end < len(numbers) and numbers[end] - numbers[end - 1] == step:
            end += 1
        if end - at < 3 or step == 0:
            end = at + 1
        yield numbers[at], numbers[end - 1], step if end > at + 1 else 1
        at = end


def numbers_of(pattern: str, names: Iterable[str]) -> list[int]:
    """Returns the frame numbers of those names that match the file name pattern, ascending; empty if the pattern has no #."""
    marks, names = list(re.finditer("#+", pattern)), set(names)
    if not marks:
        return []
    start, end = marks[-1].span()
    written = re.compile(rf"{re.escape(pattern[:start])}(\d{{{end - start},}}){re.escape(pattern[end:])}")
    found = {int(match[1]) for match in map(written.fullmatch, names) if match and len(match[1]) < 10}
    return sorted(number for number in found if frame_name(pattern, number) in names)


def frame_name(pattern: str, frame: float) -> str:
    """Returns the file name of a frame: the pattern with its last run of # replaced by the number, zero-padded to that length.

    `out.####.exr` -> `out.0012.exr`. A half frame gets the suffix .5: `out.0012.5.exr`. A pattern without # is the name of every
    frame.
    """
    marks = list(re.finditer("#+", pattern))
    if not marks:
        return pattern
    start, end = marks[-1].span()
    number = f"{int(frame):0{end - start}d}" + (".5" if frame != int(frame) else "")
    return pattern[:start] + number + pattern[end:]
