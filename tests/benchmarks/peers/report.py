"""All measurements of a run of the comparison, and their output as text, as JSON, and as a plot for each row."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from tests.benchmarks.peers.measure import Line, geometric_mean
from tests.benchmarks.peers.targets import TABLE, Goal

__all__ = ["Report", "Verdict"]


@dataclass(frozen=True)
class Verdict:
    """A measured value of a row, with the target that it should meet."""

    row: str
    name: str
    value: float
    goal: Goal

    @property
    def met(self) -> bool:
        """Whether the value meets its target."""
        return self.goal.met(self.value)

    def __str__(self) -> str:
        return f"{self.row}, {self.name}: {self.value:.3g}, {self.goal} is asked for"


@dataclass
class Report:
    """All measurements of a run.

    machine: description of the machine. missing: reasons why rows could not be measured, by row. only: names of the requested
    lines; if not all were requested, no means are printed.
    """

    machine: dict[str, Any]
    quick: bool
    lines: list[Line] = field(default_factory=list)
    missing: dict[str, str] = field(default_factory=dict)
    only: tuple[str, ...] = ()

    def rows(self) -> dict[str, list[Line]]:
        """Returns the lines of each row, in the table's order."""
        return {row: lines for row in TABLE if (lines := [line for line in self.lines if line.row == row])}

    def verdicts(self) -> Iterable[Verdict]:
        """Yields a verdict for each line that has a target, and one for each row whose geometric mean has one.

        Means are left out if only some lines were requested.
        """
        for row, lines in self.rows().items():
            target = TABLE[row]
            for line in lines:
                if (goal := target.goal_of(line.name)) is not None:
                    yield Verdict(row, line.name, line.value, goal)
            together = [line.value for line in lines if line.name not in target.lines]
            if target.mean is not None and together and not self.only:
                yield Verdict(row, "geometric mean", geometric_mean(together), target.mean)

    def text(self) -> str:
        """Returns the whole table as text, followed by the missed targets."""
        said = {(v.row, v.name): v for v in self.verdicts()}
        parts = [", ".join(f"{key} {value}" for key, value in self.machine.items())]
        for row, lines in self.rows().items():
            parts += ["", f"{row}: {TABLE[row].title} ({TABLE[row].unit})"]
            parts += [_shown(line, said.get((row, line.name))) for line in lines]
            if (mean := said.get((row, "geometric mean"))) is not None:
                parts.append(f"  {'geometric mean':<40} {mean.value:8.3g} {'':<21} {_judged(mean)}")
        parts += ["", *(f"not measured: {row}: {why.splitlines()[0]}" for row, why in self.missing.items())]
        short = [v for v in said.values() if not v.met]
        parts.append(f"{len(said) - len(short)} of {len(said)} reached." + (" Short of what is asked for:" if short else ""))
        parts += [f"  {v}" for v in short]
        if self.quick:
            parts.append("Quick: of small scenes and one round, to see that every row works; these are not the table's figures.")
        if self.only:
            parts.append(f"Of the lines only: {'; '.join(self.only)}. So there are no geometric means.")
        return "\n".join(parts)

    def write(self, folder: Path) -> None:
        """Writes peers.json, peers.txt and one plot per row into this folder."""
        folder.mkdir(parents=True, exist_ok=True)
        verdicts = [{**asdict(v), "met": v.met} for v in self.verdicts()]
        data = {
            "machine": self.machine,
            "quick": self.quick,
            "lines": [asdict(line) for line in self.lines],
            "verdicts": verdicts,
            "missing": self.missing,
        }
        (folder / "peers.json").write_text(json.dumps(data, indent=1) + "\n")
        (folder / "peers.txt").write_text(self.text() + "\n")
        self._plot(folder)

    def _plot(self, folder: Path) -> None:
        from tests.benchmarks.peers.plots import plot_curves, plot_row

        for row, lines in self.rows().items():
            draw = plot_curves if row == "scaling" else plot_row
            draw(row, lines, folder / f"{row}.png")


def _shown(line: Line, verdict: Verdict | None) -> str:
    spread = f"({line.spread[0]:.3g} to {line.spread[1]:.3g})"
    sides = [f"{who} {_middle(values):.3g}" for who, values in (("ours", line.ours), ("peer", line.peers)) if values]
    beside = f"{', '.join(sides)} {line.unit}" if line.peers else ""
    return f"  {line.name:<40} {line.value:8.3g} {spread:<21} {_judged(verdict):<22} {beside}".rstrip()


def _judged(verdict: Verdict | None) -> str:
    return "" if verdict is None else f"{verdict.goal} {'ok' if verdict.met else 'SHORT'}"


def _middle(values: tuple[float, ...]) -> float:
    return sorted(values)[len(values) // 2]
