"""Comparison with Mitsuba, Embree and Cycles, each at its fastest, in alternating rounds. Rows without a peer have targets too.

    python3 farm.py bench peers [--quick] [--long] [--rows samples,rays] [--only "Cornell box,textured mesh"] [--out FOLDER]
    python3 farm.py bench peers --against COMMIT [--rounds 15] [--spp 4]   # row samples, compared with another commit

Prints medians, spread and ratios next to the targets, and the lines that miss theirs; writes peers.json, peers.txt and a plot for
each row. Exits with 1 if a row cannot be measured, not if one misses its target. Takes hours without --quick, on an otherwise
idle machine.
"""

from __future__ import annotations

import argparse
import os
import platform
import re
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest

from renderer.render import warm_up
from tests.benchmarks.peers.against import against_lines
from tests.benchmarks.peers.cold import cold_lines
from tests.benchmarks.peers.cycles import cycles_lines
from tests.benchmarks.peers.errors import error_lines
from tests.benchmarks.peers.formats import format_lines
from tests.benchmarks.peers.measure import Line
from tests.benchmarks.peers.pictures import sample_lines
from tests.benchmarks.peers.rays import build_lines, ray_lines
from tests.benchmarks.peers.ready import ready_lines
from tests.benchmarks.peers.report import Report
from tests.benchmarks.peers.scaling import scaling_lines
from tests.benchmarks.peers.sizes import FULL, QUICK, Sizes, begins
from tests.benchmarks.peers.surroundings import MissingPeerError, find_llvm
from tests.benchmarks.peers.threads import thread_lines
from tests.helpers import ROOT

ROWS: dict[str, Callable[..., Iterator[Line]]] = {
    "samples": sample_lines,
    "error": error_lines,
    "cycles": cycles_lines,
    "rays": ray_lines,
    "build": build_lines,
    "ready": ready_lines,
    "formats": format_lines,
    "threads": thread_lines,
    "cold": cold_lines,
    "scaling": scaling_lines,
}
_HELD_AGAINST_CONVERGED = ("error", "cycles")
LONG_FILE = 10_000_000  # triangles
BUSY = 0.3  # share of a core used by other processes


def main() -> int:
    """Measures, prints and writes the results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="small scenes and one round: whether every row works")
    parser.add_argument("--long", action="store_true", help=f"also a file of {LONG_FILE:,} triangles")
    parser.add_argument("--rows", type=_rows, default=list(ROWS), metavar="NAME,...", help=f"of {', '.join(ROWS)}")
    parser.add_argument(
        "--only",
        type=_names,
        default=(),
        metavar="NAME,...",
        help="of the rows' lines, by the names that they are printed with, or what these begin with up to a comma",
    )
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "bench-peers", help="where the results go (%(default)s)")
    parser.add_argument("--against", metavar="COMMIT", help="in place of the peers: another commit of ours, in turn")
    parser.add_argument("--rounds", type=int, default=15, help="with --against: rounds of each scene (%(default)s)")
    parser.add_argument("--spp", type=int, default=4, help="with --against: samples a pixel of a round (%(default)s)")
    options = parser.parse_args()
    sizes = QUICK if options.quick else FULL
    if options.long:
        sizes = replace(sizes, ready=(*sizes.ready, LONG_FILE))
    sizes = replace(sizes, only=options.only)
    report = Report(_machine(), options.quick, only=options.only)
    if options.against:
        rest = {"commit": options.against, "quick": options.quick, "rounds": options.rounds, "spp": options.spp}
        _measure("against", partial(against_lines, **rest), sizes, report)
        report.write(options.out)
        options.rows = []
    else:
        warm_up()
    for row in options.rows:
        lines = partial(ROWS[row], kept=options.out / "references") if row in _HELD_AGAINST_CONVERGED else ROWS[row]
        _measure(row, lines, sizes, report)
        report.write(options.out)
    print("\n" + report.text())
    print(f"Written to {options.out}")
    measured = [line.name for line in report.lines]
    if unknown := [name for name in options.only if not any(begins(name, line) for line in measured)]:
        print(f"No line of these rows is called {' or '.join(unknown)}.", file=sys.stderr)
        return 1
    return 1 if report.missing else 0


def _measure(row: str, lines: Callable[..., Iterator[Line]], sizes: Sizes, report: Report) -> None:
    """Measures the lines of one table row, and adds them to the report.

    An error in one row is reported and does not prevent the other rows.
    """
    begun = time.perf_counter()
    print(f"{row} ...", flush=True)
    try:
        with tempfile.TemporaryDirectory(prefix="rayfarm-peers-") as folder:
            for line in lines(sizes, Path(folder)):
                if sizes.only and not any(begins(name, line.name) for name in sizes.only):
                    continue  # measured together with a requested row
                report.lines.append(line)
                print(f"  {line.name}: {line.value:.3g} after {time.perf_counter() - begun:.0f} s", flush=True)
    except MissingPeerError as error:
        report.missing[row] = str(error)
    except (Exception, pytest.fail.Exception) as error:
        traceback.print_exc()
        report.missing[row] = f"{type(error).__name__}: {error}"


def _rows(text: str) -> list[str]:
    names = text.split(",")
    unknown = [name for name in names if name not in ROWS]
    if unknown:
        raise argparse.ArgumentTypeError(f"there is no row {', '.join(unknown)}; known are {', '.join(ROWS)}")
    return names


def _names(text: str) -> tuple[str, ...]:
    """Returns the names in a comma-separated text; a comma followed by a space is part of a name."""
    return tuple(name.strip() for name in re.split(r",(?! )", text) if name.strip())


def _machine() -> dict[str, Any]:
    """Returns a description of this machine and its load."""
    cores = len(os.sched_getaffinity(0))
    load = os.getloadavg()[0]
    if load > BUSY:
        print(
            f"This machine is not quiet (load {load:.1f} on {cores} cores): do not take its figures for facts.", file=sys.stderr
        )
    known = Path("/proc/cpuinfo")
    models = [line.split(":", 1)[1].strip() for line in known.read_text().splitlines() if line.startswith("model name")]
    return {
        "processor": models[0] if models else platform.processor(),
        "cores": cores,
        "load": round(load, 2),
        "python": platform.python_version(),
        **{name: version(name) for name in ("numba", "numpy", "mitsuba", "drjit")},
        "llvm": str(os.environ.get("DRJIT_LIBLLVM_PATH", find_llvm())),
    }


if __name__ == "__main__":
    os.chdir(ROOT)
    sys.exit(main())
