"""What a service takes, against slots, tile size or frame size."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib

from tests.benchmarks.scale.measured import Load, Taken

matplotlib.use("Agg")

from matplotlib import pyplot

__all__ = ["plot"]

_OURS, _LIMIT = "#3b6ea5", "#c0392b"


def plot(rows: Sequence[tuple[Load, Taken]], path: Path) -> None:
    """Three curves over what the loads differ in: share of the slots in use, the service's processor, its time for a batch."""
    name, labels = _differing([load for load, _ in rows])
    curves = {
        "share of what the slots could render": ([taken.sample_rate / _possible(load) for load, taken in rows], 1.0),
        "cores that the service uses": ([taken.service_s / taken.seconds for _, taken in rows], 1.0),
        "ms of a core per batch": ([1e3 * taken.service_s / max(taken.merged, 1) for _, taken in rows], None),
    }
    figure, axes = pyplot.subplots(1, len(curves), figsize=(11, 3.2), layout="constrained")
    for plane, (title, (values, limit)) in zip(axes, curves.items(), strict=True):
        plane.plot(labels, values, "o-", color=_OURS)
        if limit is not None:
            plane.axhline(limit, color=_LIMIT, linestyle=":")
        plane.set_ylim(bottom=0)
        plane.set_title(title, fontsize="medium")
        plane.set_xlabel(name)
        plane.grid(alpha=0.3)
    figure.savefig(path, dpi=110)
    pyplot.close(figure)


def _possible(load: Load) -> float:
    """Samples of tiles that the slots could render in a second."""
    return load.slots / (load.sample_s * (load.tile / 128) ** 2)


def _differing(loads: Sequence[Load]) -> tuple[str, list[str]]:
    sides = [f"{load.tile}" for load in loads]
    frames = [f"{load.width} x {load.height}" for load in loads]
    if len(set(sides)) > 1:
        return "pixels along a tile's side", sides
    return ("frame", frames) if len(set(frames)) > 1 else ("slots", [f"{load.slots:,}" for load in loads])
