"""Row `threads` of the comparison: speedup from one thread to two. No peer."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from tests.benchmarks.peers.contestants import Rayfarm
from tests.benchmarks.peers.measure import Line, race, ratio_line, taken
from tests.benchmarks.peers.scenes import CASES
from tests.benchmarks.peers.sizes import Sizes
from tests.benchmarks.peers.surroundings import MissingPeerError

__all__ = ["thread_lines"]

_ASKED = ("Cornell box", "large mesh, diffuse", "textured mesh")


def thread_lines(sizes: Sizes, folder: Path) -> Iterator[Line]:
    """Measures how much faster two threads render than one; yields one line per scene."""
    if len(os.sched_getaffinity(0)) < 2:
        raise MissingPeerError("this machine lets the benchmark use one core alone")
    for name in _ASKED:
        if sizes.wants(name):
            yield _line(name, Rayfarm(CASES[name](sizes), sizes.picture), sizes)


def _line(name: str, scene: Rayfarm, sizes: Sizes) -> Line:
    scene.picture(1, 0)
    run = race(
        lambda _: taken(lambda: scene.picture(sizes.spp, 1, threads=2)),
        lambda _: taken(lambda: scene.picture(sizes.spp, 1, threads=1)),
        sizes.rounds,
    )
    total = sizes.picture**2 * sizes.spp / 1e6
    rates = [[total / seconds for seconds in side] for side in run.seconds]
    return ratio_line("threads", name, run.ratios, "M samples/s", *rates, cpu_ratio=run.cpu_ratio)
