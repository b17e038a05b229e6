"""Rows `error-time` and `error-samples`: the noise of pictures compared with Mitsuba's best sampler, multijitter.

Each renderer is compared with its own converged picture, so that different material models do not matter. At equal time, Rayfarm
takes as many samples as it renders in Mitsuba's time for its number of samples, which is a square number.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from pathlib import Path

from tests.benchmarks.peers.contestants import Mitsuba, Rayfarm
from tests.benchmarks.peers.measure import Line, error_line, race, relative_error, taken
from tests.benchmarks.peers.references import OURS, References
from tests.benchmarks.peers.scenes import CASES, Case
from tests.benchmarks.peers.sizes import Sizes

__all__ = ["error_lines"]

_NOT_ASKED = ("large mesh, rough plastic",)  # has the same noise as its diffuse variant


def error_lines(sizes: Sizes, folder: Path, kept: Path | None = None) -> Iterator[Line]:
    """Compares the errors of Rayfarm's and Mitsuba's pictures; yields two lines per scene: at equal time, at equal samples.

    kept: folder of converged pictures, reused between runs.
    """
    for name, make in CASES.items():
        if name not in _NOT_ASKED and sizes.wants(name):
            yield from _lines(name, make(sizes), References(sizes, kept), folder)


def _lines(name: str, case: Case, references: References, folder: Path) -> Iterator[Line]:
    sizes = references.sizes
    spp = sizes.error_spp
    in_time = max(1, round(spp * _times_faster(case, sizes, folder)))
    ours, theirs = Rayfarm(case, sizes.error_picture), Mitsuba(case, sizes.error_picture, "multijitter", folder)
    seeds = range(1, 1 + sizes.rounds)
    their_truth = references.of(name, f"mitsuba {theirs.mi.__version__}", theirs.picture)
    our_truth = references.of(name, OURS, ours.picture)
    peers = [relative_error(theirs.picture(spp, seed), their_truth) for seed in seeds]
    means = {"our_mean": float(our_truth.mean()), "peer_mean": float(their_truth.mean())}
    for row, count in (("error-time", in_time), ("error-samples", spp)):
        errors = [relative_error(ours.picture(count, seed), our_truth) for seed in seeds]
        yield error_line(row, name, errors, peers, our_samples=count, peer_samples=spp, **means)


def _times_faster(case: Case, sizes: Sizes, folder: Path) -> float:
    """Returns Mitsuba's wall time divided by ours, for pictures with equally many samples.

    The pictures have the size of row `samples`, at which the start-up time of a render matters little.
    """
    ours, theirs = Rayfarm(case, sizes.picture), Mitsuba(case, sizes.picture, "multijitter", folder)
    spp = sizes.error_spp
    ours.picture(1, 0)
    theirs.picture(spp, 0)
    run = race(
        lambda number: taken(lambda: ours.picture(spp, 1 + number)),
        lambda number: taken(lambda: theirs.picture(spp, 1 + number)),
        sizes.rounds,
    )
    return statistics.median(run.ratios)
