"""Row `samples` of the comparison: our samples per second against Mitsuba's.

Mitsuba uses its fastest sampler, independent; we use Sobol'.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from tests.benchmarks.peers.contestants import Mitsuba, Rayfarm
from tests.benchmarks.peers.measure import Line, race, ratio_line, taken
from tests.benchmarks.peers.scenes import CASES, Case
from tests.benchmarks.peers.sizes import Sizes

__all__ = ["sample_lines"]


def sample_lines(sizes: Sizes, folder: Path) -> Iterator[Line]:
    """Compares samples per second of Rayfarm and Mitsuba; yields one line per scene."""
    for name, make in CASES.items():
        if sizes.wants(name):
            yield _line(name, make(sizes), sizes, folder)


def _line(name: str, case: Case, sizes: Sizes, folder: Path) -> Line:
    """Renders one scene in alternating rounds, after a warm-up, and returns its line.

    Both renderers do equal work: one light sample and one BSDF sample per path vertex.
    """
    ours, theirs = Rayfarm(case, sizes.picture, splitting=1), Mitsuba(case, sizes.picture, "independent", folder)
    spp = sizes.spp
    ours.picture(1, 0)
    theirs.picture(spp, 0)
    run = race(
        lambda number: taken(lambda: ours.picture(spp, 1 + number)),
        lambda number: taken(lambda: theirs.picture(spp, 1 + number)),
        sizes.rounds,
    )
    total = sizes.picture**2 * spp / 1e6
    rates = [[total / seconds for seconds in side] for side in run.seconds]
    rays = ours.stats.rays / ours.stats.samples
    return ratio_line("samples", name, run.ratios, "M samples/s", *rates, cpu_ratio=run.cpu_ratio, rays_a_sample=rays)
