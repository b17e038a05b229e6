"""Reads and compiles one scene file in a separate process, and prints its cost as JSON.

python -m tests.benchmarks.peers.ready_once FILE
"""

from __future__ import annotations

import json
import resource
import sys
import time
from importlib import import_module
from pathlib import Path

from renderer.arrays.scene import flat
from renderer.formats import FORMATS
from renderer.preparation_kernels import prepare
from renderer.render import warm_up
from renderer.scene.compile import compile_scene
from renderer.scene.load import read


def _used() -> tuple[float, float, int]:
    """Returns user and system seconds of this process and its children, and the maximum over them of peak memory in KiB."""
    both = [resource.getrusage(whose) for whose in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(r.ru_utime for r in both), sum(r.ru_stime for r in both), max(r.ru_maxrss for r in both)


def main() -> None:
    path = Path(sys.argv[1])
    warm_up()
    prepare()
    import_module(f"renderer.scene.readers.{next(f.reader for f in FORMATS if f.suffix == path.suffix)}")
    begun, used = time.perf_counter(), _used()
    description = read(path.parent, path.name)
    read_after = time.perf_counter() - begun
    scene = compile_scene(description)
    wall, now = time.perf_counter() - begun, _used()
    took = {
        "wall": wall,
        "read": read_after,
        "user": now[0] - used[0],
        "system": now[1] - used[1],
        "bytes_a_triangle": sum(array.nbytes for array in flat(scene).values()) / len(scene.triangle),
        "most_memory": now[2] * 1024,
    }
    print(json.dumps(took))


if __name__ == "__main__":
    main()
