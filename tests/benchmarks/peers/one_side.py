"""Renders a scene of row `samples` on request, with the code of one of two commits that against.py compares.

Run in the root of the commit's working tree. The command line has the scene's name and a size. For each line of standard input it
renders once, and prints the processor seconds.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path.cwd()))

from renderer.render import RenderStats, render_frame
from renderer.scene.compile import compile_scene
from tests.benchmarks.peers.scenes import CASES
from tests.benchmarks.peers.sizes import FULL, QUICK


def main() -> None:
    """Renders on request until standard input ends."""
    name, size, spp = sys.argv[1:]
    sizes = QUICK if size == "quick" else FULL
    case = CASES[name](sizes)
    scene, settings = compile_scene(case.description), case.settings(sizes.picture, splitting=1)
    stats = RenderStats()
    render_frame(scene, settings, 1, stats=stats)  # compiles the kernel
    print("ready", flush=True)
    for line in sys.stdin:
        begun = time.process_time()
        render_frame(scene, replace(settings, seed=int(line)), int(spp), stats=stats)
        print(time.process_time() - begun, flush=True)


if __name__ == "__main__":
    main()
