"""Row `ready`: from a GLB file to a renderable scene, in seconds and bytes. No peer.

Python's start, the imports and the kernels are not counted; the file is in the system's cache.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from tests.benchmarks.peers.files import large_file
from tests.benchmarks.peers.measure import Line
from tests.benchmarks.peers.sizes import Sizes
from tests.helpers import ROOT

__all__ = ["ready_lines"]


def ready_lines(sizes: Sizes, folder: Path) -> Iterator[Line]:
    """Yields two lines for each size of file: seconds until its scene is ready, and bytes of the compiled scene per triangle."""
    for triangles in sizes.ready:
        name = f"{triangles / 1e6:g} M triangles"
        if not sizes.wants(name):
            continue
        path = large_file(folder / f"{triangles}.glb", triangles)
        path.read_bytes()
        runs = []
        for _ in range(sizes.rounds):
            command = [sys.executable, "-m", "tests.benchmarks.peers.ready_once", str(path)]
            done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
            runs.append(json.loads(done.stdout))
        path.unlink()
        walls = tuple(run["wall"] for run in runs)
        notes = {key: statistics.median(run[key] for run in runs) for key in ("read", "user", "system", "most_memory")}
        yield Line("ready", f"{name}, seconds", statistics.median(walls), (min(walls), max(walls)), "s", walls, notes=notes)
        size = runs[0]["bytes_a_triangle"]
        yield Line("ready", f"{name}, bytes each", size, (size, size), "bytes", (size,))
