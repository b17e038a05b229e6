"""Program that renders with Cycles for the comparison, in a Python that has bpy."""

from __future__ import annotations

import time
from typing import Any

import bpy

from tests.benchmarks.peers.answering import answer
from tests.peers.cycles_render import prepare


def load(glb: str, size: int, max_depth: int, sky: list[float]) -> dict[str, Any]:
    """Loads a GLB file and selects its camera. size: picture size in pixels. sky: radiance of the uniform sky."""
    prepare(glb, size, max_depth, sky)
    bpy.context.scene.render.use_persistent_data = (
        True  # the built scene is cached, so that pictures take only their samples' time
    )
    return {"version": bpy.app.version_string}


def render(samples: int, seed: int, exr: str = "") -> dict[str, Any]:
    """Renders the loaded scene to an EXR file, and returns the time."""
    scene = bpy.context.scene
    scene.cycles.samples, scene.cycles.seed = samples, seed
    scene.render.filepath = exr
    begun, used = time.perf_counter(), time.process_time()
    bpy.ops.render.render(write_still=bool(exr))
    return {"wall": time.perf_counter() - begun, "cpu": time.process_time() - used}


if __name__ == "__main__":
    answer({"load": load, "render": render})
