"""Reads every scene file below given folders, each in a process of its own, and counts what comes of them by format.

    python3 farm.py bench files --in DIR... [--packages] [--timeout 60] [--jobs 2] [--refusals]

A file loads, loads with warnings (that a studio lights it is none), is refused with a sentence, crashes (any other end) or is
slow (over the time limit). The counts in docs/correctness.md are of this table.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import sysconfig
import time
from collections import defaultdict
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

from renderer.formats import SCENE_SUFFIXES
from renderer.scene.studio import STUDIO_NOTES

_ENDS = ("loads", "warnings", "refused", "crashed", "slow")


class Found(NamedTuple):
    """What came of one file."""

    path: Path
    end: str  # one of _ENDS
    seconds: float
    said: str


def scene_files(folders: Iterable[Path]) -> list[Path]:
    """The scene files below folders, or those named themselves."""
    found: dict[Path, None] = {}
    for folder in folders:
        paths = [folder] if folder.is_file() else sorted(folder.rglob("*"))
        found |= dict.fromkeys(path.resolve() for path in paths if path.suffix.lower() in SCENE_SUFFIXES and path.is_file())
    return list(found)


def read_one(path: Path, timeout: float) -> Found:
    """Reads and compiles one file by `rayfarm info`."""
    begun = time.perf_counter()
    command = [sys.executable, "-m", "rayfarm", "info", "--json", str(path)]
    try:
        done = subprocess.run(command, capture_output=True, timeout=timeout, check=False)
    except subprocess.TimeoutExpired:
        return Found(path, "slow", timeout, f"over {timeout:g} s")
    seconds = time.perf_counter() - begun
    errors = done.stderr.decode("utf-8", "replace").strip()
    if done.returncode == 0:
        warnings = [w for w in json.loads(done.stdout)["warnings"] if w not in STUDIO_NOTES]
        return Found(path, "warnings" if warnings else "loads", seconds, "; ".join(warnings))
    sentence = errors.splitlines()[-1] if errors else ""
    is_refused = done.returncode == 1 and "Traceback" not in errors and errors.startswith("rayfarm:")
    return Found(path, "refused" if is_refused else "crashed", seconds, sentence or f"exit code {done.returncode}")


def table(found: list[Found]) -> str:
    """The counts and times as a table in Markdown."""
    by_format: dict[str, list[Found]] = defaultdict(list)
    for each in found:
        by_format[each.path.suffix.lower()].append(each)
    lines = ["| format | files | load | of these with warnings | refused | crashed | slow | median s | longest s |"]
    lines.append("|---|--:|--:|--:|--:|--:|--:|--:|--:|")
    for name, those in [*sorted(by_format.items()), ("all", found)]:
        count = {end: sum(each.end == end for each in those) for end in _ENDS}
        times = [each.seconds for each in those]
        loaded = count["loads"] + count["warnings"]
        numbers = [len(those), loaded, count["warnings"], count["refused"], count["crashed"], count["slow"]]
        spread = f"{statistics.median(times):.1f} | {max(times):.1f}" if times else "- | -"
        lines.append(f"| {name} | {' | '.join(map(str, numbers))} | {spread} |")
    return "\n".join(lines)


def main() -> None:
    """Reads the command line, and prints the table. Exits with 1 where a file crashes."""
    parser = argparse.ArgumentParser(description="Reads every scene file below folders, and counts what comes of them.")
    parser.add_argument("--in", dest="folders", nargs="*", default=[], type=Path, metavar="DIR", help="folders of scene files")
    parser.add_argument("--packages", action="store_true", help="also the files that installed packages bring")
    parser.add_argument("--timeout", type=float, default=60.0, help="seconds for one file")
    parser.add_argument("--jobs", type=int, default=2, help="files that are read at a time")
    parser.add_argument("--refusals", action="store_true", help="list what is said of files that do not load")
    given = parser.parse_args()
    folders = [*given.folders, *([Path(sysconfig.get_path("purelib"))] if given.packages else [])]
    if not folders:
        print("No folder is given: python3 farm.py bench files --in DIR... [--packages]")
        return
    files = scene_files(folders)
    with ThreadPoolExecutor(given.jobs) as pool:
        found = list(pool.map(lambda path: read_one(path, given.timeout), files))
    print(table(found))
    for each in found:
        if each.end == "crashed" or (given.refusals and each.end in ("refused", "slow")):
            print(f"{each.end}: {each.path}: {each.said}")
    if any(each.end == "crashed" for each in found):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
