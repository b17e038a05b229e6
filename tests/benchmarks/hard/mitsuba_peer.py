"""Program that renders a scene of hard light with Mitsuba: paths on one thread, compiled by LLVM."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks.hard.rayfarm_files import case_of
from tests.benchmarks.hard.scenes import SCENES, SIZE
from tests.benchmarks.peers.answering import answer
from tests.benchmarks.peers.contestants import Mitsuba

_AT_ONCE = 32  # samples per pixel of a pass; another number would be compiled anew
_SEEDS = 4096  # of a picture: one for each pass

_loaded: dict[str, Mitsuba] = {}


def load(scene: str, method: str) -> dict[str, Any]:
    """Reads a scene. method: path."""
    import drjit

    with tempfile.TemporaryDirectory(prefix="rayfarm-hard-") as folder:
        _loaded["scene"] = Mitsuba(case_of(SCENES[scene](), Path(folder)), SIZE, "independent", Path(folder))
    drjit.set_thread_count(1)
    return {"version": f"Mitsuba {_loaded['scene'].mi.__version__}, {method}"}


def render(samples: int, seed: int, path: str, plain: bool = False) -> dict[str, Any]:
    """Renders the scene to a file of NumPy, and returns the processor time. The samples are rounded up to whole passes."""
    passes = -(-samples // _AT_ONCE)
    total = np.zeros((SIZE, SIZE, 3))
    used = time.process_time()
    for number in range(passes):
        total += _loaded["scene"].picture(_AT_ONCE, seed * _SEEDS + number)
    used = time.process_time() - used
    np.save(f"{path}.npy", (total / passes).astype(np.float32))
    return {"seconds": used, "samples": passes * _AT_ONCE, "path": f"{path}.npy"}


if __name__ == "__main__":
    answer({"load": load, "render": render})
