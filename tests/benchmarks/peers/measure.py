"""Clocks, alternating rounds, and errors relative to a converged picture."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

__all__ = ["Line", "Race", "Taken", "error_line", "geometric_mean", "race", "ratio_line", "relative_error", "taken"]

_TRIMMED = 0.001  # share of pixels with the largest errors that is ignored, so that fireflies do not dominate
_FLOOR = 0.01  # share of the reference's mean square that is added, for black pixels


@dataclass(frozen=True)
class Taken:
    """A measured time: wall seconds, and processor seconds of all threads, which are NaN if unknown."""

    wall: float
    cpu: float = math.nan


@dataclass
class Line:
    """A line of the comparison's table.

    value: compared with the target. spread: minimum and maximum over the rounds. ours, peers: the measurements by round, in
    `unit`. notes: further figures by name.
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
    """Returns the wall and processor time that this process takes for a call of `work`."""
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return Taken(time.perf_counter() - wall, time.process_time() - cpu)


@dataclass(frozen=True)
class Race:
    """The times of both sides by round, and the clock by which they are compared."""

    ours: list[Taken]
    theirs: list[Taken]
    clock: Literal["wall", "cpu"] = "wall"

    @property
    def seconds(self) -> tuple[list[float], list[float]]:
        """Times of both sides by round: (ours, theirs)."""
        return [getattr(t, self.clock) for t in self.ours], [getattr(t, self.clock) for t in self.theirs]

    @property
    def ratios(self) -> list[float]:
        """Their time divided by ours, by round."""
        return [b / a for a, b in zip(*self.seconds, strict=True)]

    @property
    def cpu_ratio(self) -> float:
        """Ratio of processor times in the fastest rounds, which depends less on other work of the machine."""
        return min(t.cpu for t in self.theirs) / min(t.cpu for t in self.ours)


def race(
    ours: Callable[[int], Taken], theirs: Callable[[int], Taken], rounds: int, clock: Literal["wall", "cpu"] = "wall"
) -> Race:
    """Measures our and the peer's function in alternating rounds; each function receives the number of the round."""
    results = Race([], [], clock)
    for number in range(rounds):
        sides = [(ours, results.ours), (theirs, results.theirs)]
        for side, kept in sides if number % 2 == 0 else reversed(sides):
            kept.append(side(number))
    return results


def ratio_line(
    row: str, name: str, ratios: Sequence[float], unit: str, ours: Sequence[float], peers: Sequence[float], **notes: Any
) -> Line:
    """Returns a line whose value is the median of the rounds' ratios."""
    return Line(row, name, statistics.median(ratios), (min(ratios), max(ratios)), unit, tuple(ours), tuple(peers), notes)


def error_line(row: str, name: str, ours: Sequence[float], peers: Sequence[float], **notes: Any) -> Line:
    """Returns a line with the peer's mean error divided by ours.

    Errors are not paired by round, since their seeds are unrelated.
    """
    return ratio_line(row, name, [statistics.fmean(peers) / error for error in ours], "relMSE", ours, peers, **notes)


def geometric_mean(values: Sequence[float]) -> float:
    """Returns the geometric mean of ratios."""
    return math.exp(statistics.fmean(math.log(v) for v in values))


def relative_error(picture: np.ndarray, reference: np.ndarray) -> float:
    """Returns the mean squared error relative to the reference's square, ignoring the 0.1 % of pixels with the largest errors."""
    truth = reference.astype(np.float64)
    square = np.square(truth).mean(-1)
    each = np.square(picture.astype(np.float64) - truth).mean(-1) / (square + _FLOOR * square.mean())
    kept = np.sort(each, axis=None)[: max(1, math.ceil(each.size * (1 - _TRIMMED)))]
    return float(kept.mean())
