"""Efficiencies of the contestants, their ratios with goals, and the tables that the benchmark of hard light prints."""

from __future__ import annotations

import json
import statistics
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks.hard.contestants import CONTESTANTS, OFF, ON, Contestant
from tests.benchmarks.hard.renders import Reference, Render
from tests.benchmarks.hard.scenes import SCENES, HardScene, Kind
from tests.benchmarks.peers.measure import relative_error
from tests.benchmarks.peers.targets import Goal, at_least

__all__ = ["GOALS", "TRIMMED", "Cell", "Report", "Verdict", "cell_of"]

TRIMMED = 0.001  # share of the pixels with the largest errors that is left out
GOALS = {"door": at_least(1.5), "window": at_least(2), "ball": at_least(20), "pool": at_least(50)}
GOALS |= {"slab": at_least(20), "niche": at_least(20)}  # lamps behind glass
AHEAD = at_least(1)  # of every unbiased peer
WITHIN = at_least(1 / 3)  # of every biased peer
_LIMITED = 0.2  # share of a reference in a measured error from which a figure is a lower bound
_DEVIATIONS, _TOLERANCE = 3.0, 0.01  # of the share of the light: standard deviations, and what always counts as equal
_OVER_OFF, _OVER_UNBIASED, _OVER_BIASED = "over `off`", "over the best unbiased peer", "over the best biased peer"


@dataclass(frozen=True)
class Cell:
    """Results of a contestant in a scene.

    efficiencies: 1 / (relative mean squared error times seconds) of each round, without the worst thousandth of the pixels;
    whole: the same with all pixels. is_limited, is_whole_limited: whether the reference's own error makes them too small.
    share: the mean of its pictures over that of the reference; noise: its standard deviation. seconds, samples: of each round.
    """

    efficiencies: tuple[float, ...]
    whole: tuple[float, ...]
    is_limited: bool
    is_whole_limited: bool
    share: float
    noise: float
    seconds: tuple[float, ...]
    samples: tuple[int, ...]

    @property
    def has_all_light(self) -> bool:
        """True if the share of the light is 1 within its noise."""
        return abs(self.share - 1) <= _DEVIATIONS * self.noise + _TOLERANCE

    def values(self, trimmed: bool) -> tuple[float, ...]:
        """Returns the efficiencies of the rounds, without the worst pixels if `trimmed`."""
        return self.efficiencies if trimmed else self.whole

    def median(self, trimmed: bool) -> float:
        """Returns the median efficiency of the rounds."""
        return statistics.median(self.values(trimmed))

    def text(self, trimmed: bool) -> str:
        """Returns the median, with the spread over the rounds; "> " before a lower bound; the share of the light if not 1."""
        values = self.values(trimmed)
        bound = "> " if (self.is_limited if trimmed else self.is_whole_limited) else ""
        spread = f" ({_short(min(values))} to {_short(max(values))})" if len(values) > 1 else ""
        light = "" if self.has_all_light else f", {self.share:.2f} of the light"
        return f"{bound}{_short(self.median(trimmed))}{spread}{light}"


def cell_of(renders: Sequence[Render], reference: Reference) -> Cell:
    """Returns the cell of one contestant and scene. renders: of its rounds, at least one."""
    truth = reference.picture
    errors = {trimmed: [relative_error(render.picture, truth, trimmed) for render in renders] for trimmed in (TRIMMED, 0.0)}
    own = {trimmed: relative_error(truth + reference.deviation, truth, trimmed) for trimmed in errors}
    efficiencies, whole = (
        tuple(1 / (error * render.seconds) for error, render in zip(errors[trimmed], renders, strict=True))
        for trimmed in (TRIMMED, 0.0)
    )
    limited = [own[trimmed] > _LIMITED * statistics.median(errors[trimmed]) for trimmed in (TRIMMED, 0.0)]
    weights = [render.samples for render in renders]
    mean = np.average([render.picture.astype(float) for render in renders], axis=0, weights=weights)
    difference = (mean - truth).mean(-1)
    return Cell(
        efficiencies,
        whole,
        *limited,
        share=float(mean.mean() / truth.mean()),
        noise=float(difference.std() / np.sqrt(difference.size) / truth.mean()),
        seconds=tuple(render.seconds for render in renders),
        samples=tuple(render.samples for render in renders),
    )


@dataclass(frozen=True)
class Verdict:
    """A ratio of efficiencies in a scene, with its goal if it has one."""

    scene: str
    name: str
    value: float
    goal: Goal | None

    def __str__(self) -> str:
        return f"{self.scene}, {self.name}: {_short(self.value)}, {self.goal} is asked for"


@dataclass
class Report:
    """All cells of a run, by scene and contestant. machine: description. missing: reasons why contestants are left out."""

    machine: dict[str, Any]
    cells: dict[tuple[str, str], Cell] = field(default_factory=dict)
    references: dict[str, str] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
    missing: dict[str, str] = field(default_factory=dict)
    quick: bool = False

    def verdicts(self, scene: str, trimmed: bool) -> list[Verdict]:
        """Returns our ratios in a scene: over `off`, the best unbiased peer and the best biased peer.

        A peer without bias in theory whose pictures lack light, or have too much, counts as biased.
        """
        own = self.cells.get((scene, ON[SCENES[scene]().kind].name))
        if own is None:
            return []
        found: list[Verdict] = []
        off = self.cells.get((scene, OFF.name))
        if off is not None:
            found.append(Verdict(scene, _OVER_OFF, own.median(trimmed) / off.median(trimmed), GOALS.get(scene)))
        for name, is_biased, goal in ((_OVER_UNBIASED, False, AHEAD), (_OVER_BIASED, True, WITHIN)):
            peers = [cell for contestant, cell in self._peers(scene) if self._is_biased(contestant, cell) == is_biased]
            if peers:
                best = max(cell.median(trimmed) for cell in peers)
                found.append(Verdict(scene, name, own.median(trimmed) / best, goal))
        return found

    def _peers(self, scene: str) -> list[tuple[Contestant, Cell]]:
        return [
            (CONTESTANTS[name], cell)
            for (where, name), cell in self.cells.items()
            if where == scene and not CONTESTANTS[name].is_ours
        ]

    @staticmethod
    def _is_biased(contestant: Contestant, cell: Cell) -> bool:
        return contestant.is_biased or not cell.has_all_light

    def text(self) -> str:
        """Returns the tables as Markdown, then what differs in its mean, missed goals, and contestants that are left out."""
        parts = [", ".join(f"{key} {value}" for key, value in self.machine.items())]
        parts += [", ".join(sorted(set(self.versions.values())))]
        for kind in ON:
            scenes = [
                scene for scene in SCENES if SCENES[scene]().kind == kind and any(where == scene for where, _ in self.cells)
            ]
            if scenes:
                for trimmed, words in ((True, "without the worst thousandth of the pixels"), (False, "all pixels")):
                    parts += ["", f"Efficiency, {kind}, {words}:", "", self.table(kind, scenes, trimmed)]
        parts += ["", *self.differences()]
        verdicts = [(v, t) for t in (True, False) for scene in SCENES for v in self.verdicts(scene, t) if v.goal is not None]
        short = [(v, t) for v, t in verdicts if v.goal is not None and not v.goal.met(v.value)]
        parts.append(f"{len(verdicts) - len(short)} of {len(verdicts)} goals reached." + (" Short of:" if short else ""))
        parts += [f"  {verdict}" + ("" if trimmed else ", with all pixels") for verdict, trimmed in short]
        parts += [f"Reference of {scene}: {words}" for scene, words in self.references.items()]
        parts += [f"Left out: {CONTESTANTS[name].title}: {why.splitlines()[0]}" for name, why in self.missing.items()]
        if self.quick:
            parts.append("Quick: short renders of one round, to see that everything works; these are not the figures.")
        return "\n".join(parts)

    def table(self, kind: Kind, scenes: Sequence[str], trimmed: bool) -> str:
        """Returns a table with a row for each contestant and ratio, and a column for each scene."""
        described: list[HardScene] = [SCENES[scene]() for scene in scenes]
        rows = [["", *(scene.title for scene in described)], ["---"] * (len(scenes) + 1)]
        for name, contestant in CONTESTANTS.items():
            if kind in contestant.kinds and any((scene, name) in self.cells for scene in scenes):
                cells = [self.cells.get((scene, name)) for scene in scenes]
                rows.append([contestant.title, *("-" if cell is None else cell.text(trimmed) for cell in cells)])
        ratios = {(v.scene, v.name): v for scene in scenes for v in self.verdicts(scene, trimmed)}
        for ratio in (_OVER_OFF, _OVER_UNBIASED, _OVER_BIASED):
            if any(name == ratio for _, name in ratios):
                rows.append([f"{ON[kind].title} {ratio} (goal)", *(_ratio(ratios.get((scene, ratio))) for scene in scenes)])
        return "\n".join(f"| {' | '.join(row)} |" for row in rows)

    def differences(self) -> list[str]:
        """Returns a sentence for each cell whose pictures do not have the mean of the reference."""
        return [
            f"{SCENES[scene]().title}, {CONTESTANTS[name].title}: {cell.share:.3f} +- {cell.noise:.3f} of the reference's light"
            for (scene, name), cell in self.cells.items()
            if not cell.has_all_light
        ]

    def write(self, folder: Path) -> None:
        """Writes hard.md and hard.json into the folder."""
        folder.mkdir(parents=True, exist_ok=True)
        cells = {
            f"{scene}, {name}": vars(cell) | {"has_all_light": cell.has_all_light} for (scene, name), cell in self.cells.items()
        }
        data = {name: getattr(self, name) for name in ("machine", "references", "versions", "missing", "quick")}
        (folder / "hard.json").write_text(json.dumps(data | {"cells": cells}, indent=1) + "\n")
        (folder / "hard.md").write_text(self.text() + "\n")


def _short(value: float) -> str:
    """Returns a number with two significant digits, and no fewer than those before the point."""
    return f"{value:.0f}" if value >= 10 else f"{value:.2g}"


def _ratio(verdict: Verdict | None) -> str:
    if verdict is None:
        return "-"
    return _short(verdict.value) + ("" if verdict.goal is None else f" ({_short(verdict.goal.bound)})")
