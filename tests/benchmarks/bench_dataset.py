"""A data set through the farm: views a second, for how much of its time each slot has no work, and BlenderProc beside it.

    python3 farm.py bench dataset [--views 200] [--size 256] [--spp 2] [--slots 2] [--still] [--outputs color,depth,instance]
                                  [--folder DIR] [--table FILE.md] [--blenderproc [VIEWS]]

`rayfarm.dataset` renders views of the Cornell box, with boxes and materials varied for each, on a local farm, and annotates them
in its own process. A slot has work while it traces paths or compiles the scenes of the next views. It has none while it opens a
scene, packs and sends sums, and takes the next message, unless it traces paths meanwhile. What counts is the time from the first
work of any slot to the last one's end. Target: no slot without work for more than 3 % of it. Prints the gaps by cause, the
machine's load, processor time by kind of process, the slowest phases, and the growth of memory and files, as Markdown tables.

With --folder, views and farm are kept in DIR: a run that was interrupted continues with the same command, and its table counts
its own views. For the proof on 10,000 views, on two quiet cores:

    python3 farm.py bench dataset --views 10000 --folder /tmp/ten-thousand --table ten-thousand.md

With --blenderproc, the still scene is rendered with colour, depth, normals, instances and flow in both directions, by the farm
and by BlenderProc's own functions with Blender as a module, one after the other, with the same size, samples, path length and
number of threads. Both are installed into .venv-blenderproc (500 MB, Python 3.11), or named by RAYFARM_BLENDERPROC_PYTHON.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import rayfarm
from rayfarm import Cameras
from tests.benchmarks.dataset.peer import Comparison, rendered_by_blenderproc
from tests.benchmarks.dataset.processes import FarmSampler
from tests.benchmarks.dataset.slots import Gap, PhaseReceiver, SlotTime, gaps_by_cause, slot_times
from tests.helpers import ROOT, start_farm, stop_farm

CORNELL = ROOT / "scenes" / "cornell-box.yaml"
TARGET = 0.03
LONGEST = 3  # gaps that are printed
MAX_DEPTH = 8
FOV = 36
PROGRESS_S = 10.0
VARY = {
    "seed": 7,
    "objects": {"*-box": {"move": {"uniform": [[-0.3, 0, -0.3], [0.3, 0, 0.3]]}, "turn": {"uniform": [0, 360]}}},
    "materials": {"white": {"color": {"choice": [[0.8, 0.8, 0.8], [0.7, 0.6, 0.4]]}}},
}
SIDE_BY_SIDE = ["color", "depth", "normal", "instance", "flow_forward", "flow_backward"]


class Run:
    """A data set made by a local farm, and what was measured meanwhile. views: those made by this run, not by an earlier one."""

    def __init__(self, options: argparse.Namespace, folder: Path, cameras: Cameras, request: dict[str, Any]) -> None:
        """Starts the farm, warms it up with other pictures, renders the missing views, and ends the farm."""
        self.load_before = os.getloadavg()[0]
        with PhaseReceiver() as receiver:
            collector: dict[str, Any] = {"OTEL_EXPORTER_OTLP_ENDPOINT": receiver.url, "OTEL_BSP_SCHEDULE_DELAY": "200"}
            farm = start_farm(folder / "farm", options.slots, **collector, OTEL_BSP_MAX_QUEUE_SIZE="20000")
            try:
                warm = {**request, "outputs": ["color"], "max_depth": 3}
                with tempfile.TemporaryDirectory(prefix="rayfarm-bench-") as other:
                    rayfarm.dataset(CORNELL, Cameras(cameras.poses[:4]), folder=other, farm=farm.url, **warm)
                _settle(receiver)
                receiver.forget()
                own = os.times()
                with FarmSampler(farm.process.pid, {"the farm's files": farm.data, "views": folder / "views"}) as sampler:
                    progress = _Progress(sampler)
                    begun = time.perf_counter()
                    made = rayfarm.dataset(
                        CORNELL, cameras, folder=folder / "views", farm=farm.url, watch=progress.update, **request
                    )
                    self.seconds = time.perf_counter() - begun
                    _settle(receiver)
                self.own_s = sum(os.times()[:2]) - sum(own[:2])
            finally:
                stop_farm(farm)
        self.views, self.annotation_s = progress.views, made.seconds["annotation"]
        self.slots = slot_times(receiver.work, options.slots)
        self.gaps = gaps_by_cause(self.slots, receiver.packed)
        self.phases, self.sampler = receiver.phases(), sampler

    @property
    def processor_s(self) -> dict[str, float]:
        """Processor seconds by kind of process."""
        return {**self.sampler.processor_s(), "annotation and files": self.own_s}


class _Progress:
    """Prints a line every ten seconds."""

    def __init__(self, sampler: FarmSampler) -> None:
        self._sampler, self._before, self._told, self._begun = sampler, -1, time.monotonic(), time.monotonic()
        self.views = 0

    def update(self, done: int, total: int) -> None:
        """Called by `rayfarm.dataset` with the number of complete views."""
        self._before = done if self._before < 0 else self._before
        self.views = self._sampler.views = done - self._before
        now = time.monotonic()
        if now - self._told >= PROGRESS_S and self.views:
            rate = self.views / (now - self._begun)
            left = (total - done) / rate / 60
            print(f"{done} of {total} views, {rate:.2f} a second, {left:.1f} minutes left", file=sys.stderr, flush=True)
            self._told = now


def main() -> None:
    """Measures and prints the results; fails if a slot has no work for longer than the target."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--views", type=int, default=200)
    parser.add_argument("--size", type=int, default=256)
    parser.add_argument("--spp", type=int, default=2, help="samples per pixel")
    parser.add_argument("--slots", type=int, default=2)
    parser.add_argument("--still", action="store_true", help="the same scene in all views")
    parser.add_argument("--outputs", default="color,depth,instance")
    parser.add_argument("--folder", type=Path, help="keep views and farm here; the same command continues an interrupted run")
    parser.add_argument("--table", type=Path, help="also write the tables to this Markdown file")
    parser.add_argument("--blenderproc", type=int, nargs="?", const=40, metavar="VIEWS", help="compare with BlenderProc instead")
    options = parser.parse_args()
    if options.blenderproc is not None:
        options.views, options.still, options.outputs = options.blenderproc, True, ",".join(SIDE_BY_SIDE)
    cameras = Cameras.sample(options.views, seed=4, radius=3.6, azimuth={"uniform": [-110, -70]}, elevation={"uniform": [-5, 20]})
    request: dict[str, Any] = {"fov": FOV, "width": options.size, "height": options.size, "spp": options.spp, "seed": 1}
    request |= {"max_depth": MAX_DEPTH, "outputs": options.outputs.split(","), "vary": None if options.still else VARY}
    with ExitStack() as stack:
        name = options.folder or Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="rayfarm-bench-")))
        name.mkdir(parents=True, exist_ok=True)
        run = Run(options, name, cameras, request)
        lines = table(options, run)
        if options.blenderproc is not None:
            lines += comparison(run, rendered_by_blenderproc(CORNELL, cameras.poses, name, FOV, MAX_DEPTH, options))
    print("\n".join(lines))
    if options.table is not None:
        options.table.write_text("\n".join(lines) + "\n")
    if max(slot.idle / slot.length for slot in run.slots) > TARGET:
        raise SystemExit(1)


def table(options: argparse.Namespace, run: Run) -> list[str]:
    """Returns the results of a run as lines of Markdown."""
    loads, views = run.sampler.loads, max(run.views, 1)
    scene = "still" if options.still else "varied"
    lines = [
        f"{run.views} views of the Cornell box ({scene}), {options.size}x{options.size}, {options.spp} samples,",
        f"{options.outputs}: {run.views / run.seconds:.2f} views a second in {run.seconds:.0f} s",
        f"on {options.slots} slots of {os.cpu_count()} cores. "
        f"Load of the machine before the farm began {run.load_before:.1f}, meanwhile {sum(loads) / len(loads):.1f}.",
        "",
        "| slot | renders | prepares scenes | without work | gaps | median gap | longest gaps |",
        "|---|---|---|---|---|---|---|",
    ]
    for number, slot in enumerate(run.slots, 1):
        lines.append(f"| {number} | {_percent(slot.rendering, slot)} | {_percent(slot.preparing, slot)} | {_idle(slot)} |")
    lines += [
        "",
        f"Target: at most {100 * TARGET:.0f} % without work.",
        "",
        "| without work | gaps | s | of the slots' time | median |",
        "|---|---|---|---|---|",
    ]
    length = sum(slot.length for slot in run.slots)
    for cause, gaps in run.gaps.items():
        share, median = 100 * sum(gaps) / length, 1000 * statistics.median(gaps)
        lines.append(f"| {cause} | {len(gaps)} | {sum(gaps):.1f} | {share:.2f} % | {median:.1f} ms |")
    lines += [
        "",
        "| processor time | s | a view | |",
        "|---|---|---|---|",
    ]
    spent = run.processor_s
    whole = sum(spent.values())
    for name, seconds in sorted(spent.items(), key=lambda each: -each[1]):
        lines.append(f"| {name} | {seconds:.1f} | {1000 * seconds / views:.1f} ms | {100 * seconds / whole:.1f} % |")
    cores = os.cpu_count() or 1
    projected = f"{10_000 * whole / views / cores / 60:.0f} min of {cores} cores for 10,000 views"
    lines.append(f"| all | {whole:.1f} | {1000 * whole / views:.1f} ms | {projected} |")
    lines += ["", "| phase | number | s | median | longest |", "|---|---|---|---|---|"]
    for name, count, total, median, longest in run.phases:
        lines.append(f"| {name} | {count} | {total:.1f} | {1000 * median:.1f} ms | {1000 * longest:.0f} ms |")
    lines += ["", "| | at half of the views | at the end | a view | 10,000 views |", "|---|---|---|---|---|"]
    # The farm's files stop growing with the third job: each is deleted once its views are written.
    for name, (middle, end, a_view) in run.sampler.growth().items():
        projected = _mb(end + max(a_view, 0.0) * max(10_000 - views, 0))
        lines.append(f"| {name} | {_mb(middle)} | {_mb(end)} | {a_view / 1000:.1f} kB | {projected} |")
    return lines


def comparison(run: Run, peer: Comparison) -> list[str]:
    """Returns the comparison with BlenderProc as lines of Markdown."""
    ours, theirs = run.views / run.seconds, peer.views / peer.seconds
    annotation = 100 * run.own_s / sum(run.processor_s.values())  # with the files
    return [
        "",
        f"BlenderProc {peer.version} with Blender {peer.blender}, {peer.views} views on {peer.threads} threads in "
        f"{peer.seconds:.1f} s:",
        "",
        "| | views a second | annotation's share | error of the colour |",
        "|---|---|---|---|",
        f"| Rayfarm, a local farm | {ours:.2f} | {annotation:.0f} % of processor time | {peer.our_error:.3f} |",
        f"| BlenderProc | {theirs:.2f} | {100 * peer.annotation_s / peer.seconds:.0f} % of time | {peer.error:.3f} |",
        f"| ratio | {ours / theirs:.1f} | | |",
        "",
        "BlenderProc renders colour, depth and normals together; instances and flow, its annotation here, are two more",
        f"renderings of each view at one sample: {peer.parts}.",
        f"Error: relative RMSE of one view's linear pixels at {peer.spp} samples",
        f"against the same renderer's {peer.reference_spp}.",
    ]


def _idle(slot: SlotTime) -> str:
    lengths = sorted((gap.ended - gap.begun for gap in slot.gaps), reverse=True)
    median = lengths[len(lengths) // 2] if lengths else 0.0
    longest: Sequence[Gap] = sorted(slot.gaps, key=lambda gap: gap.begun - gap.ended)[:LONGEST]
    said = ", ".join(f"{1000 * (gap.ended - gap.begun):.0f} ms at {gap.begun:.0f} s after `{gap.after}`" for gap in longest)
    return f"{_percent(slot.idle, slot)} | {len(lengths)} | {1000 * median:.1f} ms | {said}"


def _percent(seconds: float, slot: SlotTime) -> str:
    return f"{100 * seconds / slot.length:.2f} %"


def _mb(size: float) -> str:
    return f"{size / 1e6:.0f} MB"


def _settle(receiver: PhaseReceiver) -> None:
    """Returns when no more spans arrive."""
    count = -1
    while count != receiver.count:
        count = receiver.count
        time.sleep(1.0)


if __name__ == "__main__":
    main()
