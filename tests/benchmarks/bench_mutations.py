"""Damaged files of all formats, each read in the bounded child as the service does it: does any end more than its child?

    python3 farm.py bench mutations [--count 10000] [--seed 1] [--formats WORDS] [--minutes M] [--keep FOLDER] [--page]

A file of one of the formats is drawn, with its textures and what else it names; one of them is damaged in a way that is drawn
too, and the scene is read and compiled in a forked child with bounds on memory and time (worker/bounded.py). What may come of
it: it is read (most damage is small), refused with a sentence of its reader's, refused by the net beneath all readers, too
large, too slow, or the child crashes, as a library in C may: then the worker says so and goes on. --keep: a folder for the
files of the last four kinds. Each number of a campaign is drawn by itself, so that `--first N --count 1` does the N-th again.
"""

from __future__ import annotations

import argparse
import gc
import os
import random
import resource
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

import psutil

from renderer.errors import SceneError
from renderer.scene.animation import Moment
from renderer.scene.compile import compile_scene
from renderer.scene.load import Shot
from renderer.scene.readers import assimp, collada, fbx, gltf, mitsuba, obj, other, pbrt, threemf, usd, yaml  # noqa: F401 - before the fork
from tests.benchmarks.mutations.damage import damaged
from tests.benchmarks.mutations.seeds import Seed, seeds
from tests.benchmarks.mutations.tally import Tally, into_page, table
from tests.helpers import ROOT
from worker.bounded import run_bounded
from worker.errors import WorkError

MEMORY = 1 << 30
SECONDS = 30.0
PAGE = ROOT / "docs" / "reliability.md"


def read(folder: Path, main: str) -> dict[str, Any]:
    """In the child."""
    try:
        shot = Shot(folder, main)
        compile_scene(shot.at(Moment(shot.start)))
        found = {"outcome": "read"}
    except SceneError as error:
        sentence = str(error)
        found = {"outcome": "refused by the net" if "could not be read as" in sentence else "refused", "sentence": sentence}
    return found | {"memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024}


def outcome(folder: Path, main: str) -> dict[str, Any]:
    """What came of a scene."""
    try:
        return run_bounded(lambda _: read(folder, main), lambda _: None, MEMORY, SECONDS, subject=main)
    except WorkError as error:
        sentence = str(error)
    if "made its reader crash" in sentence:
        return {"outcome": "child crashed", "sentence": sentence}
    if "GiB that this worker" in sentence:
        return {"outcome": "too large", "sentence": sentence}
    if "took longer" in sentence:
        return {"outcome": "too slow", "sentence": sentence}
    return {"outcome": "refused by the net" if "cannot be read" in sentence else "child crashed", "sentence": sentence}


def draw(number: int, seed: int, all_seeds: dict[str, list[Seed]]) -> tuple[str, str, dict[str, bytes], str]:
    """The format, the main file, all files and how one of them is damaged, of the number-th of a campaign."""
    dice = random.Random(f"{seed}:{number}")
    kind = dice.choice(sorted(all_seeds))
    main, files = dice.choice(all_seeds[kind])
    chosen = main if dice.random() < 0.75 else dice.choice(sorted(files))
    data, how = damaged(files[chosen], dice)
    return kind, main, {**files, chosen: data}, f"{chosen}: {how}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=2000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--formats", nargs="*", default=[], help="parts of their names")
    parser.add_argument("--keep", type=Path)
    parser.add_argument("--minutes", type=float, default=0.0, help="end after so many, with the table of those that were done")
    parser.add_argument("--nice", type=int, default=10)
    parser.add_argument("--page", action="store_true", help=f"the table into {PAGE.relative_to(ROOT)}")
    options = parser.parse_args()
    os.nice(options.nice)
    all_seeds = {k: v for k, v in seeds().items() if not options.formats or any(w.lower() in k.lower() for w in options.formats)}
    found: dict[str, Tally] = defaultdict(Tally)
    with tempfile.TemporaryDirectory(prefix="rayfarm-mutations-") as name:
        for (
            kind,
            given,
        ) in all_seeds.items():  # sound files are read, here: what each reader loads is loaded before children are forked
            for i, (sound, files) in enumerate(given):
                folder = _placed(Path(name) / f"{sorted(all_seeds).index(kind)}-{i}", files)
                result = read(folder, sound)
                if result["outcome"] != "read":
                    sys.exit(f"The sound file {sound} of {kind} is not read: {result['sentence']}")
        gc.freeze()  # so that no child copies what its collector touches
        started = time.monotonic()
        before = psutil.Process().memory_info().rss
        for number in range(options.first, options.first + options.count):
            kind, sound, files, how = draw(number, options.seed, all_seeds)
            if options.minutes and time.monotonic() > started + 60 * options.minutes:
                break
            folder = _placed(Path(name) / "case", files)
            begun = time.monotonic()
            result = outcome(folder, sound)
            found[kind].add(result["outcome"], time.monotonic() - begun, result.get("memory", 0))
            if result["outcome"] not in ("read", "refused"):
                print(f"{number} {kind} {how}: {result['outcome']}: {result['sentence'][:300]}", flush=True)
                if options.keep:
                    _placed(options.keep / str(number), files)
            for path in folder.iterdir():
                path.unlink()
            if (number + 1) % 250 == 0:
                print(f"{number + 1} done", file=sys.stderr, flush=True)
        grown = psutil.Process().memory_info().rss - before
    text = table(found)
    print(text)
    print(f"The process that read them all has grown by {grown / 2**20:.0f} MiB.")
    if options.page:
        into_page(PAGE, text)
    return 0


def _placed(folder: Path, files: dict[str, bytes]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        (folder / name).write_bytes(data)
    return folder


if __name__ == "__main__":
    sys.exit(main())
