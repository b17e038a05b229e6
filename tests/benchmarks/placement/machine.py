"""A worker on another machine: it downloads compiled scenes instead of mapping them from the service's folder, and records that.

python -m tests.benchmarks.placement.machine --opened FILE --service URL --slots 1 --name NAME --cache FOLDER

FILE gets a line of JSON for each scene that a slot opens: its hash, whether this machine had it, and wall and processor seconds.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

from renderer.scene.compiled import CompiledScene
from worker import __main__ as program
from worker.exchange import cache
from worker.exchange.cache import BlobCache
from worker.exchange.link import FarmAnswer
from worker.work import render, scenes


def no_shared_folder(farm: FarmAnswer) -> Path | None:
    """Returns None: the service's blobs lie on another machine."""
    return None


def record_openings(file: Path) -> None:
    """Makes the slots of this process append a line to `file` for each compiled scene that they open."""

    def open_scene(found: BlobCache, sha256: str) -> CompiledScene:
        was_here = (found.folder / sha256[:2] / sha256).is_file()
        begun = time.perf_counter(), time.process_time()
        scene = scenes.open_scene(found, sha256)
        took = time.perf_counter() - begun[0], time.process_time() - begun[1]
        with file.open("a") as lines:
            lines.write(json.dumps({"scene": sha256, "was_here": was_here, "wall_s": took[0], "processor_s": took[1]}) + "\n")
        return scene

    render.open_scene = open_scene


if __name__ == "__main__":
    at = sys.argv.index("--opened")
    record_openings(Path(sys.argv[at + 1]))
    del sys.argv[at : at + 2]
    cache._service_blob_folder = no_shared_folder
    sys.exit(program.main())
