"""Renders a scene of row `samples` on request, in the working tree of one of two commits that are compared.

Run it in the root of the working tree to be measured. It reads a scene's name and a size from the command line, then renders once
for each line of standard input, and writes the processor seconds of each.
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
