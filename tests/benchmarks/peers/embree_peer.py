"""Program that traces rays with Embree for the comparison, in a Python that has embreex.

embreex calls rtcIntersect1 or rtcOccluded1 for each ray.
"""

from __future__ import annotations

import time
from importlib.metadata import version
from typing import Any

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from tests.benchmarks.peers.answering import answer

_kept: dict[str, Any] = {}


def build(mesh: str) -> dict[str, Any]:
    """Builds Embree's BVH of a mesh on all cores; returns the time of rtcCommitScene only. mesh: path of an .npz file."""
    if _kept.get("mesh") != mesh:
        with np.load(mesh) as file:
            _kept.update(mesh=mesh, position=file["position"], triangle=file["triangle"])
    scene = EmbreeScene()  # Embree's defaults: medium quality, not robust
    _kept.update(shape=TriangleMesh(scene, _kept["position"], _kept["triangle"]), scene=scene)
    nowhere = np.full((1, 3), 1e6, np.float32), np.ones((1, 3), np.float32)
    begun, used = time.perf_counter(), time.process_time()
    scene.run(*nowhere)  # the first ray commits the scene
    return {"wall": time.perf_counter() - begun, "cpu": time.process_time() - used}


def trace(rays: str, query: str, reach: float) -> dict[str, Any]:
    """Traces rays through the BVH that was built last. rays: path of an .npz file.

    reach: maximum distance, in multiples of the length of a ray's direction.
    """
    if _kept.get("rays") != rays:
        with np.load(rays) as file:
            _kept.update(rays=rays, origin=file["origin"], direction=file["direction"])
    origin, direction = _kept["origin"], _kept["direction"]
    ends = np.full(len(origin), reach, np.float32)
    begun, used = time.perf_counter(), time.process_time()
    found = _kept["scene"].run(origin, direction, ends, query=query)
    return {
        "wall": time.perf_counter() - begun,
        "cpu": time.process_time() - used,
        "hits": int((found >= 0).sum()),
    }


def about() -> dict[str, Any]:
    """Returns Embree's version, which is also the version of embreex."""
    return {"version": version("embreex")}


if __name__ == "__main__":
    answer({"about": about, "build": build, "trace": trace})
