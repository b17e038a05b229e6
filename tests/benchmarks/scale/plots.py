"""Plots of a service's cost against slots, tile size or frame size."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import cycle
from pathlib import Path

import matplotlib

from tests.benchmarks.scale.measured import Load, Taken

matplotlib.use("Agg")

from matplotlib import pyplot

__all__ = ["plot"]

_LOOKS = (("#3b6ea5", "o"), ("#2e8b57", "s"), ("#8e5ea2", "^"))
_LIMIT = "#c0392b"
_TILES = "pixels along a tile's side"


def plot(rows: Sequence[tuple[Load, Taken]], path: Path) -> None:
    """Plots three figures over the quantity in which the rows differ, such as the number of slots.

    They are the used share of the slots, the service's processor time, and its time per batch. If both tile and frame size
    differ, each frame size has its own curve.
    """
    name, label = _axis([load for load, _ in rows])
    curves: dict[str, list[tuple[Load, Taken]]] = {}
    for load, taken in rows:
        curves.setdefault(_frame(load) if name == _TILES else "", []).append((load, taken))
    planes: dict[str, tuple[Callable[[Load, Taken], float], float | None]] = {
        "share of what the slots could render": (lambda load, taken: taken.sample_rate / _possible(load), 1.0),
        "cores that the service uses": (lambda _, taken: taken.service_s / taken.seconds, 1.0),
        "ms of a core per batch": (lambda _, taken: 1e3 * taken.service_s / max(taken.merged, 1), None),
    }
    figure, axes = pyplot.subplots(1, len(planes), figsize=(11, 3.2), layout="constrained")
    for plane, (title, (value, limit)) in zip(axes, planes.items(), strict=True):
        for (frame, curve), (color, marker) in zip(curves.items(), cycle(_LOOKS)):
            labels, values = [label(load) for load, _ in curve], [value(load, taken) for load, taken in curve]
            plane.plot(labels, values, f"{marker}-", color=color, label=frame)
        if limit is not None:
            plane.axhline(limit, color=_LIMIT, linestyle=":")
        plane.set_ylim(bottom=0)
        plane.set_title(title, fontsize="medium")
        plane.set_xlabel(name)
        plane.grid(alpha=0.3)
    if len(curves) > 1:
        axes[-1].legend(title="frame", fontsize="small")
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


def _possible(load: Load) -> float:
    """Returns the number of tile samples that the slots can render per second."""
    return load.slots / (load.sample_s * (load.tile / 128) ** 2)


def _frame(load: Load) -> str:
    return f"{load.width} x {load.height}"


def _axis(loads: Sequence[Load]) -> tuple[str, Callable[[Load], str]]:
    """Returns (name, function) of the quantity in which the loads differ; the function returns a load's value as text."""
    if len({load.tile for load in loads}) > 1:
        return _TILES, lambda load: f"{load.tile}"
    if len({_frame(load) for load in loads}) > 1:
        return "frame", _frame
    return "slots", lambda load: f"{load.slots:,}"
