"""Files with up to 100,000 elements of one kind: how the time to read and compile them grows with their number.

    python3 farm.py bench many [WORDS ...] [--count 4000] [--times 4] [--seconds 60] [--memory 4]

For each kind of element, files with one count and with several times as many are generated and read in a bounded child process.
Reported are the processor seconds of both, the exponent of the growth (1: twice as many take twice as long), and the time
extrapolated to 100,000 elements. Up to an exponent of 1.3 the growth counts as linear, since caches are finite.
"""

from __future__ import annotations

import argparse
import gc
import math
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from renderer.errors import SceneError
from renderer.formats import pick_main
from renderer.scene.compile import compile_scene, summarise
from renderer.scene.load import Shot
from renderer.scene.readers import assimp, collada, fbx, gltf, mitsuba, obj, pbrt, ply, stl, threemf, trimesh_files, usd, yaml  # noqa: F401 - before the fork
from tests.benchmarks.bench_mutations import write_files
from tests.benchmarks.many.gltf import GLTF
from tests.benchmarks.many.text import TEXT
from tests.benchmarks.many.usd import USD
from tests.bounded import run_bounded
from worker.exchange.errors import WorkError

MANY = 100_000
STEEP = 1.3
LEAST = 0.2  # seconds; for shorter times no growth is computed

THINGS: dict[str, Any] = {**TEXT, **GLTF, **USD}


def read(folder: Path, main: str) -> dict[str, Any]:
    """Reads a scene in the child process; returns the outcome and the processor seconds."""
    begun = time.process_time()
    try:
        shot = Shot(folder, main)
        description = shot.scene_at()
        half = time.process_time()
        compiled = compile_scene(description, threads=1)
        summarise(description, compiled)
    except SceneError as error:
        return {"said": str(error), "seconds": time.process_time() - begun}
    now = time.process_time()
    return {"seconds": now - begun, "reading": half - begun, "warnings": len(description.warnings)}


def measured(files: dict[str, bytes], folder: Path, memory: int, seconds: float) -> dict[str, Any]:
    """Writes files to a folder, reads the scene there in a new child process, and returns what `read` measured.

    memory, seconds: limits of the child process, in bytes and seconds.
    """
    main = pick_main(list(files))[0]
    write_files(folder, files)
    try:
        return run_bounded(lambda _: read(folder, main), lambda _: None, memory, seconds, subject=main)
    except WorkError as error:
        return {"said": str(error), "seconds": math.nan}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("words", nargs="*", help="parts of names")
    parser.add_argument("--count", type=int, default=4000)
    parser.add_argument("--times", type=int, default=4)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--memory", type=float, default=4.0, help="GiB")
    options = parser.parse_args()
    chosen = {
        name: make for name, make in THINGS.items() if not options.words or any(w.lower() in name.lower() for w in options.words)
    }
    memory, counts = int(options.memory * (1 << 30)), (options.count, options.count * options.times)
    steep = []
    print(f"{'':34}{counts[0]:>9}{counts[1]:>9}   power  {MANY:>8}   seconds of the processor")
    with tempfile.TemporaryDirectory(prefix="rayfarm-many-") as name:
        folder = Path(name)
        for thing, make in chosen.items():
            read(write_files(folder / "few", make(2)), pick_main(list(make(2)))[0])  # loads modules before children are forked
            gc.freeze()
            found = [measured(make(count), folder / "many", memory, options.seconds) for count in counts]
            few, many = (max(each["seconds"], 1e-3) for each in found)
            power = math.log(many / few) / math.log(options.times)
            said = next((each["said"] for each in reversed(found) if "said" in each), "")
            is_steep = math.isnan(many) or (many > LEAST and power > STEEP)
            steep += [thing] if is_steep else []
            expected = many * (MANY / counts[1]) ** max(power, 1.0)
            print(
                f"{thing:34}{few:9.2f}{many:9.2f}{power:8.2f}{'!' if is_steep else ' '}{expected:9.1f}   {said[:110]}", flush=True
            )
    print(f"More than linear, or not done in time: {', '.join(steep) or 'none'}.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
