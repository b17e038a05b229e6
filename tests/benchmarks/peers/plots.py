"""Plots of the comparison's rows: bars with targets, or curves of cost for row `scaling`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib

from tests.benchmarks.peers.measure import Line
from tests.benchmarks.peers.targets import TABLE

matplotlib.use("Agg")

from matplotlib import pyplot
from matplotlib.ticker import NullFormatter

__all__ = ["plot_curves", "plot_row"]

_OURS, _ASKED = "#3b6ea5", "#c0392b"


def plot_row(row: str, lines: Sequence[Line], path: Path) -> None:
    """Plots a row's lines as bars, each with its spread over the rounds and its target.

    A dotted line marks the target of the row's geometric mean.
    """
    target = TABLE[row]
    figure, axes = pyplot.subplots(figsize=(8, 1.2 + 0.42 * len(lines)), layout="constrained")
    for y, line in enumerate(lines):
        low, high = line.value - line.spread[0], line.spread[1] - line.value
        axes.barh(y, line.value, color=_OURS, xerr=[[max(low, 0)], [max(high, 0)]], ecolor="black", capsize=3, height=0.6)
        axes.annotate(f" {line.value:.3g}", (max(line.value, line.spread[1]), y), va="center")
        if (goal := target.goal_of(line.name)) is not None:
            axes.plot([goal.bound] * 2, [y - 0.4, y + 0.4], color=_ASKED, linewidth=2.5)
    if target.mean is not None:
        axes.axvline(target.mean.bound, color=_ASKED, linestyle=":", label=f"geometric mean: {target.mean}")
        figure.legend(loc="outside lower right")
    axes.set_yticks(range(len(lines)), [line.name for line in lines])
    axes.invert_yaxis()
    axes.margins(x=0.1)
    axes.set_xlabel(target.unit)
    figure.suptitle(target.title, fontsize="medium")
    figure.savefig(path, dpi=120)
    pyplot.close(figure)


def plot_curves(row: str, lines: Sequence[Line], path: Path) -> None:
    """Plots the processor seconds of a row's lines over the varied count, such as triangles, with the allowed growth."""
    figure, axes = pyplot.subplots(1, len(lines), figsize=(3.4 * len(lines), 3.4), layout="constrained", squeeze=False)
    for plot, line in zip(axes[0], lines, strict=True):
        notes = line.notes or {}
        plot.plot(notes["places"], notes["seconds"], "o-", color=_OURS, label="measured")
        plot.plot(notes["places"], notes["allowed_seconds"], "--", color=_ASKED, label="allowed")
        plot.set_xscale("log")
        plot.set_xticks(notes["places"], [f"{n:,}" for n in notes["places"]], rotation=45)
        plot.xaxis.set_minor_formatter(NullFormatter())
        if line.name not in ("triangles", "lights"):
            plot.set_yscale("log")
        plot.set_ylim(bottom=None if plot.get_yscale() == "log" else 0)
        plot.set_title("pixels across" if line.name == "pixels" else line.name)
        plot.set_ylabel("processor seconds")
        plot.legend()
    figure.suptitle(TABLE[row].title)
    figure.savefig(path, dpi=120)
    pyplot.close(figure)
