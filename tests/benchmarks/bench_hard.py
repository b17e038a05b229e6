"""Hard light, as rooms behind a door and caustics, at equal processor time: with guiding and caustics, without, and beside peers.

    python3 farm.py bench hard [--quick] [--scenes door,pool] [--contestants off,caustics,cycles-caustics] [--rounds 3]
                               [--seconds 5] [--reference-seconds 120] [--out FOLDER] [--again]

Each contestant renders the same scenes on one thread in a process of its own, in turn, each round with another seed. Efficiency
is 1 / (relative mean squared error times processor seconds). Start-up and compilation are not counted; training and photons are.
Prints Markdown tables with ratios and goals, and writes them as hard.md and hard.json. Pictures and references are kept in the
folder: an interrupted run continues, and rounds that the folder has of the same sources are not rendered again without --again.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import platform
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tests.benchmarks.hard.contestants import CONTESTANTS, Contestant
from tests.benchmarks.hard.renders import Render, Renderer, kept_render, opened, reference_of, seed_of, store_render
from tests.benchmarks.hard.report import Report, cell_of
from tests.benchmarks.hard.scenes import SCENES
from tests.benchmarks.peers.surroundings import MissingPeerError
from tests.helpers import ROOT

QUICK_SECONDS, QUICK_REFERENCE = 0.3, 2.0


def main() -> int:
    """Measures, prints and writes the results. Returns 1 if a contestant cannot be measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one round of short renders: whether everything works")
    parser.add_argument("--scenes", type=_scenes, default=list(SCENES), metavar="NAME,...", help=f"of {', '.join(SCENES)}")
    parser.add_argument(
        "--contestants", type=_contestants, default=list(CONTESTANTS), metavar="NAME,...", help=f"of {', '.join(CONTESTANTS)}"
    )
    parser.add_argument("--rounds", type=int, default=3, help="of each scene (%(default)s)")
    parser.add_argument("--seconds", type=float, default=5.0, help="processor time of each picture (%(default)s)")
    parser.add_argument("--reference-seconds", type=float, default=120.0, help="processor time of each reference (%(default)s)")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "bench-hard", help="where everything goes (%(default)s)")
    parser.add_argument("--again", action="store_true", help="render the rounds again; references are kept")
    options = parser.parse_args()
    if options.quick:
        options.rounds, options.seconds, options.reference_seconds = 1, QUICK_SECONDS, QUICK_REFERENCE
        options.out = options.out / "quick"
    if options.again:
        shutil.rmtree(options.out / "pictures", ignore_errors=True)
    report = Report(_machine(options), quick=options.quick)
    contestants = _installed([CONTESTANTS[name] for name in options.contestants], report)
    for scene in options.scenes:
        _measure(scene, [each for each in contestants if SCENES[scene]().kind in each.kinds], options, report)
        report.write(options.out)
    print("\n" + report.text())
    print(f"Written to {options.out}")
    return 1 if report.missing else 0


def _installed(contestants: Sequence[Contestant], report: Report) -> list[Contestant]:
    """Returns the contestants whose renderers are installed or can be; the report names the others."""
    found = []
    for contestant in contestants:
        try:
            contestant.python()
            found.append(contestant)
        except MissingPeerError as error:
            report.missing[contestant.name] = str(error)
    return found


def _measure(scene: str, contestants: Sequence[Contestant], options: argparse.Namespace, report: Report) -> None:
    """Renders what is missing of one scene, in turn, and adds its cells to the report.

    An error of one contestant is reported, and the others go on.
    """
    print(f"{scene}: reference ...", flush=True)
    reference = reference_of(options.out, scene, options.reference_seconds)
    report.references[scene] = f"{reference.seconds:.0f} s, {reference.kind}"
    failed: set[str] = set()
    with contextlib.ExitStack() as stack:
        running: dict[str, Renderer] = {}
        for number in range(options.rounds):
            turn = contestants if number % 2 == 0 else contestants[::-1]
            for each in turn:
                if each.name in failed or kept_render(options.out, each, scene, number, options.seconds):
                    continue
                try:
                    if each.name not in running:
                        running[each.name] = stack.enter_context(opened(each, scene, options.seconds))
                    render = running[each.name].render(options.seconds, seed_of(number))
                except (RuntimeError, OSError) as error:
                    failed.add(each.name)
                    report.missing[each.name] = f"{scene}: {error}"
                    print(f"  {each.name} failed: {error}", file=sys.stderr, flush=True)
                    continue
                store_render(options.out, each, scene, number, options.seconds, render)
                words = f"round {number + 1}, {each.name}: {render.samples} samples in {render.seconds:.2f} s"
                print(f"  {words}, mean {render.picture.mean() / reference.picture.mean():.3f}", flush=True)
    for each in contestants:
        found = [kept_render(options.out, each, scene, number, options.seconds) for number in range(options.rounds)]
        renders: list[Render] = [render for render in found if render is not None]
        if renders:
            report.cells[scene, each.name] = cell_of(renders, reference)
            report.versions[each.name] = renders[0].version
    for sentence in report.differences():
        if sentence.startswith(SCENES[scene]().title):
            print(f"  {sentence}")


def _scenes(text: str) -> list[str]:
    return _known(text, list(SCENES), "scene")


def _contestants(text: str) -> list[str]:
    return _known(text, list(CONTESTANTS), "contestant")


def _known(text: str, names: Sequence[str], what: str) -> list[str]:
    """Returns the names in a comma-separated text, in the order of `names`. Raises an error for unknown ones."""
    given = text.split(",")
    unknown = [name for name in given if name not in names]
    if unknown:
        raise argparse.ArgumentTypeError(f"there is no {what} {', '.join(unknown)}; known are {', '.join(names)}")
    return [name for name in names if name in given]


def _machine(options: argparse.Namespace) -> dict[str, Any]:
    """Returns a description of this machine, its load, and the sizes of the run."""
    known = Path("/proc/cpuinfo")
    lines = known.read_text().splitlines() if known.exists() else []
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return {
        "processor": models[0] if models else platform.processor(),
        "cores": len(os.sched_getaffinity(0)),
        "load": round(os.getloadavg()[0], 2),
        "seconds": options.seconds,
        "rounds": options.rounds,
    }


if __name__ == "__main__":
    os.chdir(ROOT)
    sys.exit(main())
