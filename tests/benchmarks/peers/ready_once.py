"""Makes one GLB file ready to be rendered, in a process that does nothing else, and says as JSON what that took.

python -m tests.benchmarks.peers.ready_once FILE
"""

from __future__ import annotations

import json
import resource
import sys
import time
from pathlib import Path

from renderer.arrays.scene import flat
from renderer.render import warm_up
from renderer.scene.compile import compile_scene
from renderer.scene.load import read


def main() -> None:
    path = Path(sys.argv[1])
    warm_up()
    begun, used = time.perf_counter(), resource.getrusage(resource.RUSAGE_SELF)
    description = read(path.parent, path.name)
    read_after = time.perf_counter() - begun
    scene = compile_scene(description)
    wall, now = time.perf_counter() - begun, resource.getrusage(resource.RUSAGE_SELF)
    took = {
        "wall": wall,
        "read": read_after,
        "user": now.ru_utime - used.ru_utime,
        "system": now.ru_stime - used.ru_stime,
        "bytes_a_triangle": sum(array.nbytes for array in flat(scene).values()) / len(scene.triangle),
        "most_memory": now.ru_maxrss * 1024,
    }
    print(json.dumps(took))


if __name__ == "__main__":
    main()
