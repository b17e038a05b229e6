"""Program that renders a scene of hard light with Rayfarm."""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from renderer import __version__
from renderer.film import mean
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from tests.benchmarks.hard.rayfarm_files import case_of
from tests.benchmarks.hard.scenes import SCENES, SIZE
from tests.benchmarks.peers.answering import answer

_loaded: dict[str, Any] = {}


def load(scene: str, method: str) -> dict[str, Any]:
    """Reads a scene. method: off, guiding or caustics: which of the two settings is on."""
    with tempfile.TemporaryDirectory(prefix="rayfarm-hard-") as folder:
        case = case_of(SCENES[scene](), Path(folder))
    _loaded.update(description=case.description, settings=case.settings(SIZE), more={} if method == "off" else {method: "on"})
    return {"version": f"Rayfarm {__version__}"}


def render(samples: int, seed: int, path: str, plain: bool = False) -> dict[str, Any]:
    """Renders the scene to a file of NumPy, and returns the processor time. plain: without guiding and caustics."""
    scene = compile_scene(_loaded["description"])  # anew, since what is learned of a scene is kept with its arrays
    settings = replace(_loaded["settings"], seed=seed, **({} if plain else _loaded["more"]))
    used = time.process_time()
    sums = render_frame(scene, settings, samples, threads=1)
    used = time.process_time() - used
    np.save(f"{path}.npy", mean(sums, settings.film_exponent).astype(np.float32))
    return {"seconds": used, "samples": samples, "path": f"{path}.npy"}


if __name__ == "__main__":
    answer({"load": load, "render": render})
