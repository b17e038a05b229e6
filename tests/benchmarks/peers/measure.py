"""Times and errors of the comparison: clocks, measurements in alternating rounds, and errors against a converged picture."""

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
    """Time taken by a call: wall seconds, and processor seconds of all threads (NaN if unknown)."""

    wall: float
    cpu: float = math.nan


@dataclass
class Line:
    """One line of the comparison's table: a measurement of one row.

    value: the number that is compared with the target. spread: minimum and maximum over the rounds. ours, peers: measurements of
    Rayfarm and of the peer by round, in `unit`. notes: further figures by name.
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
    """Calls `work`, and returns the wall and processor time that this process takes meanwhile."""
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    return Taken(time.perf_counter() - wall, time.process_time() - cpu)


@dataclass(frozen=True)
class Race:
    """Times of Rayfarm and of a peer, by round.

    clock: which of a round's two times is compared.
    """

    ours: list[Taken]
    theirs: list[Taken]
    clock: Literal["wall", "cpu"] = "wall"

    @property
    def seconds(self) -> tuple[list[float], list[float]]:
        """Times of all rounds by `clock`: (Rayfarm's, the peer's)."""
        return [getattr(t, self.clock) for t in self.ours], [getattr(t, self.clock) for t in self.theirs]

    @property
    def ratios(self) -> list[float]:
        """The peer's time divided by Rayfarm's, for each round."""
        return [b / a for a, b in zip(*self.seconds, strict=True)]

    @property
    def cpu_ratio(self) -> float:
        """The peer's processor time divided by Rayfarm's, each in its own fastest round.

        Other work of the machine affects this ratio less.
        """
        return min(t.cpu for t in self.theirs) / min(t.cpu for t in self.ours)


def race(
    ours: Callable[[int], Taken], theirs: Callable[[int], Taken], rounds: int, clock: Literal["wall", "cpu"] = "wall"
) -> Race:
    """Calls `ours` and `theirs` in alternating rounds, and returns the times that they report.

    Both receive the round's number.
    """
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
    """Returns a line whose value is the peer's mean error divided by ours.

    The errors of a round are not divided by each other, since both sides use unrelated seeds.
    """
    return ratio_line(row, name, [statistics.fmean(peers) / error for error in ours], "relMSE", ours, peers, **notes)


def geometric_mean(values: Sequence[float]) -> float:
    """Returns the geometric mean of ratios."""
    return math.exp(statistics.fmean(math.log(v) for v in values))


def relative_error(picture: np.ndarray, reference: np.ndarray, trimmed: float = _TRIMMED) -> float:
    """Returns the mean squared error relative to the reference's square.

    trimmed: the share of pixels with the largest errors that is left out.
    """
    truth = reference.astype(np.float64)
    square = np.square(truth).mean(-1)
    each = np.square(picture.astype(np.float64) - truth).mean(-1) / (square + _FLOOR * square.mean())
    kept = np.sort(each, axis=None)[: max(1, math.ceil(each.size * (1 - trimmed)))]
    return float(kept.mean())
