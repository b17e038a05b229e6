"""Damaged files of all formats, each read in a bounded child process: checks that none affects more than its child.

    python3 farm.py bench mutations [--count 10000] [--seed 1] [--formats WORDS] [--in DIR ...] [--minutes M]
                                      [--jobs 2] [--keep FOLDER] [--page]

For each number of a campaign a file of one format is drawn, with its textures and other referenced files; one of them is damaged
in a random way, and the scene is read and compiled in a forked child with limits on memory and time (tests/bounded.py). Outcomes:
it is read (most damage is small), refused by its reader, refused by the handler for unexpected errors, too large, too slow, or
the child crashes in a C library, which a worker reports before it continues. --keep: a folder for the files of the last four
kinds. Times are processor seconds. Each number is drawn independently, so `--first N --count 1` repeats the N-th.

A child reads several files in sequence; a file that is neither read nor refused is read again by a separate child, whose outcome
counts. .blend files need a Python with bpy, named by RAYFARM_BPY_PYTHON; without one they are left out.
"""

from __future__ import annotations

import argparse
import gc
import os
import resource
import shutil
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil

from renderer.blender.program import NAMED
from renderer.errors import SceneError
from renderer.formats import pick_main
from renderer.scene.animation import Moment
from renderer.scene.compile import compile_scene
from renderer.scene.load import Shot
from renderer.scene.readers import assimp, collada, fbx, gltf, mitsuba, obj, pbrt, ply, stl, threemf, trimesh_files, usd, yaml  # noqa: F401 - before the fork
from service.errors import FarmError
from service.intake.archives import extract_archive
from service.store.blobs import BlobFolder
from tests.benchmarks.mutations.reading import Came, peak_memory, read_all, reset_peak_memory
from tests.benchmarks.mutations.seed import Seed, draw, kind_of, packed
from tests.benchmarks.mutations.seeds import from_folders, seeds
from tests.benchmarks.mutations.tally import Tally, into_page, table
from tests.bounded import Bounds, run_bounded
from tests.helpers import ROOT
from tests.peers.blender import python_with_bpy
from worker.exchange.errors import WorkError

MEMORY = 1 << 30
BLENDER_MEMORY = 8 << 30  # address space: Blender reserves 6 GiB before it opens anything
SECONDS = 30.0
SLOW = 5.0
PAGE = ROOT / "docs" / "fault-tests.md"
BLEND = ".blend"


def read(folder: Path, main: str) -> dict[str, Any]:
    """Reads and compiles a scene in the child process, and returns the outcome."""
    reset_peak_memory()
    begun = _used()
    try:
        if main.endswith(".zip"):
            folder, main = _expanded(folder / main, folder)
        shot = Shot(folder, main)
        compile_scene(shot.scene_at(Moment(shot.start)))
        found = {"outcome": "read"}
    except (SceneError, FarmError) as error:
        sentence = str(error)
        found = {"outcome": _refusal(sentence), "sentence": sentence}
    found["used"] = _used() - begun
    below = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss * 1024 if main.endswith(BLEND) else 0
    return found | {"memory": max(peak_memory(), below)}


def _used() -> float:
    """Returns the processor seconds used so far by this process and its ended children."""
    return sum(sum(resource.getrusage(whose)[:2]) for whose in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def _refusal(sentence: str) -> str:
    """Returns the outcome (such as "too slow" or "refused") for which a reader's error sentence stands."""
    if "ended while it opened it" in sentence:
        return "child crashed"  # Blender's own process crashed
    if "took longer" in sentence:
        return "too slow"
    return "refused by the net" if "could not be read as" in sentence else "refused"


def _expanded(archive: Path, folder: Path) -> tuple[Path, str]:
    """Extracts a zip as the service does; returns the folder and the main file."""
    store = BlobFolder(folder / ".blobs", folder / ".temporary")
    out = folder / ".scene"
    out.mkdir()
    names = []
    with archive.open("rb") as file:
        for name, writer in extract_archive(file, archive.name, store, 1000, 1 << 30, 200.0, lambda _: None):
            path = out / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(writer.rewind().read())
            writer.discard()
            names.append(name)
    return out, pick_main(names)[0]


def outcome(folder: Path, main: str) -> dict[str, Any]:
    """Returns the outcome of reading a scene in a child process of its own."""
    memory = BLENDER_MEMORY if main.endswith(BLEND) else MEMORY
    try:
        return run_bounded(lambda _: read(folder, main), lambda _: None, memory, SECONDS, subject=main)
    except WorkError as error:
        sentence = str(error)
    if "made its reader crash" in sentence:
        return {"outcome": "child crashed", "sentence": sentence}
    if "GiB that this worker" in sentence:
        return {"outcome": "too large", "sentence": sentence}
    if "took longer" in sentence:
        return {"outcome": "too slow", "sentence": sentence}
    return {"outcome": "refused by the net" if "cannot be read" in sentence else "child crashed", "sentence": sentence}


class Campaign:
    """A series of damaged files, read in a folder."""

    def __init__(self, seed: int, all_seeds: dict[str, list[Seed]], folder: Path, jobs: int) -> None:
        self._seed, self._seeds, self._folder, self._jobs = seed, all_seeds, folder, jobs

    def of(self, number: int) -> tuple[str, str, dict[str, bytes], str]:
        """Returns (format, main file, files, damage) of the number-th file; see `draw`."""
        return draw(number, self._seed, self._seeds)

    def sound(self) -> None:
        """Reads the undamaged files in this process, and exits the program if one of them cannot be read.

        As a side effect, the children are forked with all needed modules imported.
        """
        for kind, given in self._seeds.items():
            for each in given:
                files = packed(each.main, each.files) if each.is_package else each.files
                result = read(write_files(self._folder / "sound", files), each.main)
                if result["outcome"] != "read":
                    sys.exit(f"The sound file {each.main} of {kind} is not read: {result['sentence']}")

    def run(self, numbers: range, until: float) -> Iterator[tuple[int, float, dict[str, Any]]]:
        """Reads the damaged files of these numbers; yields (number, wall seconds, outcome), in any order.

        No further file is begun after `until`, in seconds of time.monotonic().
        """
        by_blender = {number for number in numbers if kind_of(number, self._seed, self._seeds) == BLEND}
        rest = (number for number in numbers if number not in by_blender)
        for some, memory in ((rest, MEMORY), (sorted(by_blender), BLENDER_MEMORY)):
            wanted = (number for number in some if time.monotonic() < until)
            doubtful = []
            for came in read_all(wanted, self._read, Bounds(memory, SECONDS), self._jobs):
                if came.answer is not None and came.answer["outcome"] in ("read", "refused"):
                    yield came.number, came.seconds, came.answer
                else:
                    doubtful.append(came)
            yield from map(self._read_again_alone, doubtful)

    def _read(self, number: int, slot: int) -> dict[str, Any]:
        """Reads the file of this number in a child process that reads many files. slot: index of that child process."""
        _, main, files, _ = self.of(number)
        return read(write_files(self._folder / f"case-{slot}", files), main)

    def _read_again_alone(self, came: Came) -> tuple[int, float, dict[str, Any]]:
        _, main, files, _ = self.of(came.number)
        begun = time.monotonic()
        result = outcome(write_files(self._folder / "again", files), main)
        return came.number, time.monotonic() - begun, result


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--formats", nargs="*", default=[], help="parts of their names")
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--minutes", type=float, default=0.0, help="end after so many, with the table of those that were done")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)), help="children at a time")
    parser.add_argument("--nice", type=int, default=10)
    parser.add_argument("--page", action="store_true", help=f"the table into {PAGE.relative_to(ROOT)}")
    parser.add_argument(
        "--in", dest="folders", nargs="+", type=Path, help="damage the small scene files below these folders instead"
    )
    options = parser.parse_args()
    os.nice(options.nice)
    if python := python_with_bpy():
        os.environ.setdefault(NAMED, str(python))
    given = from_folders(options.folders) if options.folders else seeds()
    all_seeds = {
        k: v for k, v in given.items() if v and (not options.formats or any(w.lower() in k.lower() for w in options.formats))
    }
    found: dict[str, Tally] = defaultdict(Tally)
    with tempfile.TemporaryDirectory(prefix="rayfarm-mutations-") as name:
        campaign = Campaign(options.seed, all_seeds, Path(name), options.jobs)
        if not options.folders:  # files from folders may already be damaged
            campaign.sound()
        gc.freeze()  # keeps children from copying memory that the garbage collector touches
        before, started = psutil.Process().memory_info().rss, time.monotonic()
        until = started + 60 * options.minutes if options.minutes else float("inf")
        numbers = range(options.first, options.first + options.count)
        for done, (number, seconds, result) in enumerate(campaign.run(numbers, until), 1):
            kind, _, files, how = campaign.of(number)
            seconds = result.get(
                "used", seconds
            )  # if the child was lost, wall time, during which others may have used the processor
            found[kind].add(result["outcome"], seconds, result.get("memory", 0))
            if result["outcome"] not in ("read", "refused"):
                print(f"{number} {kind} {how}: {result['outcome']}: {result['sentence'][:300]}", flush=True)
                if options.keep:
                    write_files(options.keep / str(number), files)
            elif seconds > SLOW:
                print(f"{number} {kind} {how}: {result['outcome']} after {seconds:.1f} s", flush=True)
            if done % 250 == 0:
                print(f"{done} done in {time.monotonic() - started:.0f} s", file=sys.stderr, flush=True)
        grown = psutil.Process().memory_info().rss - before
    text = table(found)
    print(text)
    took = (time.monotonic() - started) / 60
    print(f"In {took:.0f} minutes. The process that forked all children has grown by {grown / 2**20:.0f} MiB.")
    if options.page:
        into_page(PAGE, text)
    return 0


def write_files(folder: Path, files: dict[str, bytes]) -> Path:
    """Empties the folder, writes `files` (contents by name) to it, and returns the folder."""
    shutil.rmtree(folder, ignore_errors=True)
    for name, data in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    return folder


if __name__ == "__main__":
    sys.exit(main())
