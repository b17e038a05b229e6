"""Clocks, rounds in turn, and how far a picture is from the converged one."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

__all__ = ["Line", "Race", "Taken", "error_line", "geometric_mean", "race", "ratio_line", "relative_error", "taken"]

_TRIMMED = 0.001  # of the pixels, those that are farthest off: a firefly would be all that is measured
_FLOOR = 0.01  # of the reference's mean square: what black pixels are measured against


@dataclass(frozen=True)
class Taken:
    """Seconds by the clock, and of the processor in all threads; the latter not a number where it is not known."""

    wall: float
    cpu: float = math.nan


@dataclass
class Line:
    """A line of the table: `value` is what is held to the goal, `spread` the least and the most of the rounds.

    ours, peers: what was measured, round by round, in `unit`. notes: further figures, by what they are.
    """

    row: str
    name: str
    value: float
    spread: tuple[float, float]
    unit: str = ""
    ours: tuple[float, ...] = ()
    peers: tuple[float, ...] = ()
    notes: dict[str, Any] | None = None


def taken(work: Callable[[], Any]) -> Taken:
    """How long this process takes for it."""
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return Taken(time.perf_counter() - wall, time.process_time() - cpu)


@dataclass(frozen=True)
class Race:
    """What both took, round by round, and by which clock they are compared."""

    ours: list[Taken]
    theirs: list[Taken]
    clock: Literal["wall", "cpu"] = "wall"

    @property
    def seconds(self) -> tuple[list[float], list[float]]:
        """Ours, theirs."""
        return [getattr(t, self.clock) for t in self.ours], [getattr(t, self.clock) for t in self.theirs]

    @property
    def ratios(self) -> list[float]:
        """How many times faster ours was."""
        return [b / a for a, b in zip(*self.seconds, strict=True)]

    @property
    def cpu_ratio(self) -> float:
        """The same of processor time, which other work on the machine changes less: of the best rounds."""
        return min(t.cpu for t in self.theirs) / min(t.cpu for t in self.ours)


def race(
    ours: Callable[[int], Taken], theirs: Callable[[int], Taken], rounds: int, clock: Literal["wall", "cpu"] = "wall"
) -> Race:
    """One after the other, round by round; who was last in a round begins the next. They are told the round's number."""
    results = Race([], [], clock)
    for number in range(rounds):
        sides = [(ours, results.ours), (theirs, results.theirs)]
        for side, kept in sides if number % 2 == 0 else reversed(sides):
            kept.append(side(number))
    return results


def ratio_line(
    row: str, name: str, ratios: Sequence[float], unit: str, ours: Sequence[float], peers: Sequence[float], **notes: Any
) -> Line:
    """A line whose value is the median of the rounds' ratios."""
    return Line(row, name, statistics.median(ratios), (min(ratios), max(ratios)), unit, tuple(ours), tuple(peers), notes)


def error_line(row: str, name: str, ours: Sequence[float], peers: Sequence[float], **notes: Any) -> Line:
    """How many times less our error is. Seeds of two sides have nothing to do with each other: no pairs, the peer's mean."""
    return ratio_line(row, name, [statistics.fmean(peers) / error for error in ours], "relMSE", ours, peers, **notes)


def geometric_mean(values: Sequence[float]) -> float:
    """Of ratios."""
    return math.exp(statistics.fmean(math.log(v) for v in values))


def relative_error(picture: np.ndarray, reference: np.ndarray) -> float:
    """The mean squared error of the pixels relative to the reference's square, without the worst thousandth of them."""
    truth = reference.astype(np.float64)
    square = np.square(truth).mean(-1)
    each = np.square(picture.astype(np.float64) - truth).mean(-1) / (square + _FLOOR * square.mean())
    kept = np.sort(each, axis=None)[: max(1, math.ceil(each.size * (1 - _TRIMMED)))]
    return float(kept.mean())
