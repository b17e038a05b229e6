"""Row `scaling`: the cost of a picture as a function of triangles, lights, pixels, samples and depth. No peer.

The value is the allowed growth of the cost from the first size to the last, divided by the measured growth. Cost is the processor
time of all threads.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from tests.benchmarks.peers.measure import Line, taken
from tests.benchmarks.peers.scenes import Case, cornell_box, displaced, many_lights
from tests.benchmarks.peers.sizes import Sizes

__all__ = ["scaling_lines"]

_PICTURE = 128  # width in pixels, except where pixels are varied
_MOST_ROUNDS = 3


def scaling_lines(sizes: Sizes, folder: Path) -> Iterator[Line]:
    """Measures how the cost of a picture grows with five quantities; yields a line for each.

    The quantities are triangles, lights, pixels, samples and depth. The notes of a line contain its curve of cost.
    """
    box = cornell_box(sizes)
    spp, many = sizes.scaling_spp, min(sizes.rounds, _MOST_ROUNDS)

    curves: dict[str, tuple[Sequence[int], Callable[[int], float], Callable[[int], list[float]]]] = {
        "triangles": (sizes.triangles, _logarithm, lambda n: _seconds(displaced(n), many, _PICTURE, spp, 8)),
        "lights": (sizes.many_lights, _logarithm, lambda n: _seconds(many_lights(n), many, _PICTURE, spp, 8)),
        "pixels": (sizes.pixels, lambda n: n * n, lambda n: _seconds(box, many, n, spp, 8)),
        "samples": (sizes.samples, float, lambda n: _seconds(box, many, _PICTURE, n, 8)),
        "depth": (sizes.depths, float, lambda n: _seconds(box, many, _PICTURE, spp, n)),
    }
    for name, curve in curves.items():
        if sizes.wants(name):
            yield _line(name, *curve)


def _logarithm(n: int) -> float:
    return 1 + math.log2(n)


def _seconds(case: Case, rounds: int, size: int, spp: int, depth: int) -> list[float]:
    """Renders the scene in several rounds; returns the processor seconds of each, without those of building the scene."""
    scene, settings = compile_scene(case.description), replace(case.settings(size), max_depth=depth)
    render_frame(scene, settings, 1)
    return [taken(lambda: render_frame(scene, settings, spp)).cpu for _ in range(rounds)]


def _line(name: str, places: Sequence[int], allowed: Callable[[int], float], cost: Callable[[int], list[float]]) -> Line:
    rounds = [cost(n) for n in places]
    curve = [statistics.median(seconds) for seconds in rounds]
    room = allowed(places[-1]) / allowed(places[0])
    ratios = [room * first / last for first, last in zip(rounds[0], rounds[-1], strict=True)]
    notes = {
        "places": list(places),
        "seconds": curve,
        "allowed_seconds": [curve[0] * allowed(n) / allowed(places[0]) for n in places],
    }
    return Line("scaling", name, room * curve[0] / curve[-1], (min(ratios), max(ratios)), "s", tuple(curve), notes=notes)
