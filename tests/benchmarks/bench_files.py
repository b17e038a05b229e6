"""Reads every scene file in the given folders, each in a separate confined process, and counts the outcomes by format.

    python3 farm.py bench files --in DIR... [--packages] [--timeout 60] [--jobs 2] [--refusals]

Outcomes: the file loads; loads with warnings (that about an added studio light does not count); is refused with an error message;
crashes its importer in native code, which also yields an error message; exceeds the time limit; or fails in any other way, which
is a bug. The counts in docs/correctness.md come from this table.
"""

from __future__ import annotations

import argparse
import os
import re
import statistics
import sysconfig
import time
from collections import defaultdict
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

from rayfarm.reading import describe
from rayfarm.reading_files import SECONDS
from renderer.errors import RayfarmError
from renderer.formats import SCENE_SUFFIXES
from renderer.scene.studio import STUDIO_NOTES

_ENDS = ("loads", "warnings", "refused", "crashed", "slow", "failed")
_COLUMNS = ("format", "files", "load", "of these with warnings", "refused", "importer crashed", "slow", "failed")
_COLUMNS += ("median s", "longest s")
# Python internals, which no sentence for a user may contain.
_INTERNAL = re.compile(r"Traceback|\b[A-Z]\w*(?:Error|Exception)\b|<class |<[\w.]+ object at |0x[0-9a-f]{6,}|NoneType|numpy\.")


class Found(NamedTuple):
    """The outcome of reading one scene file."""

    path: Path
    end: str  # one of _ENDS
    seconds: float
    said: str


def scene_files(folders: Iterable[Path]) -> list[Path]:
    """Returns all scene files in `folders`; an entry that is itself a file is returned unchanged."""
    found: dict[Path, None] = {}
    for folder in folders:
        paths = [folder] if folder.is_file() else sorted(folder.rglob("*"))
        found |= dict.fromkeys(path.resolve() for path in paths if path.suffix.lower() in SCENE_SUFFIXES and path.is_file())
    return list(found)


def read_one(path: Path) -> Found:
    """Reads and compiles one file, as `rayfarm info` does, and returns the outcome."""
    begun = time.perf_counter()
    end, said = "loads", ""
    try:
        warnings = [w for w in describe(path)["warnings"] if w not in STUDIO_NOTES]
        end, said = ("warnings" if warnings else "loads"), "; ".join(warnings)
    except RayfarmError as error:
        said = str(error)
        end = "crashed" if "its importer crashed" in said else "slow" if " took longer than " in said else "refused"
    except Exception as error:
        end, said = "failed", f"{type(error).__name__}: {error}"
    if _INTERNAL.search(said):
        end = "failed"
    return Found(path, end, time.perf_counter() - begun, said)


def table(found: list[Found]) -> str:
    """Returns the counts and times as a Markdown table."""
    by_format: dict[str, list[Found]] = defaultdict(list)
    for each in found:
        by_format[each.path.suffix.lower()].append(each)
    lines = [f"| {' | '.join(_COLUMNS)} |", "|---" + "|--:" * (len(_COLUMNS) - 1) + "|"]
    for name, those in [*sorted(by_format.items()), ("all", found)]:
        count = {end: sum(each.end == end for each in those) for end in _ENDS}
        times = [each.seconds for each in those]
        loaded = count["loads"] + count["warnings"]
        numbers = [len(those), loaded, count["warnings"], count["refused"], count["crashed"], count["slow"], count["failed"]]
        spread = f"{statistics.median(times):.2f} | {max(times):.1f}" if times else "- | -"
        lines.append(f"| {name} | {' | '.join(map(str, numbers))} | {spread} |")
    return "\n".join(lines)


def main() -> None:
    """Parses the command line and prints the table. Exits with 1 if a file fails."""
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
    os.environ[SECONDS] = str(given.timeout)
    with ThreadPoolExecutor(given.jobs) as pool:
        found = list(pool.map(read_one, files))
    print(table(found))
    for each in found:
        if each.end == "failed" or (given.refusals and each.end in ("refused", "crashed", "slow")):
            print(f"{each.end}: {each.path}: {each.said}")
    if any(each.end == "failed" for each in found):
        raise SystemExit(1)


if __name__ == "__main__":
    main()
