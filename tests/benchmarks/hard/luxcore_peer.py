"""Program that renders a scene of hard light with LuxCore, in a Python that has pyluxcore."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from tests.benchmarks.hard.luxcore_scene import Properties, luxcore_meshes, picture_properties, scene_properties
from tests.benchmarks.hard.scenes import SCENES, SIZE
from tests.benchmarks.peers.answering import answer

_POLL = 0.05  # seconds

_loaded: dict[str, Any] = {}


def load(scene: str, method: str) -> dict[str, Any]:
    """Builds a scene. method: of luxcore_scene.METHODS."""
    import pyluxcore  # prints, and standard output is for answers only once `answer` runs

    pyluxcore.Init(lambda _: None)
    described, made = SCENES[scene](), pyluxcore.Scene()
    for mesh in luxcore_meshes(described):
        made.DefineMesh(*mesh, None, None, None)
    made.Parse(_properties(scene_properties(described)))
    _loaded.update(scene=made, method=method)
    return {"version": f"LuxCore {pyluxcore.Version()}"}


def render(samples: int, seed: int, path: str, plain: bool = False) -> dict[str, Any]:
    """Renders the scene to a file of NumPy, and returns the processor time. plain: by paths without a cache."""
    import pyluxcore

    settings = _properties(picture_properties("path" if plain else _loaded["method"], samples, seed))
    session = pyluxcore.RenderSession(pyluxcore.RenderConfig(settings, _loaded["scene"]))
    used = time.process_time()
    session.Start()
    while not session.HasDone() and _passes(session) < samples:
        time.sleep(_POLL)
    session.Stop()
    used = time.process_time() - used
    pixels = np.zeros(SIZE * SIZE * 3, np.float32)
    session.GetFilm().GetOutputFloat(pyluxcore.FilmOutputType.RGB, pixels, 0)
    np.save(f"{path}.npy", pixels.reshape(SIZE, SIZE, 3)[::-1])
    return {"seconds": used, "samples": _passes(session), "path": f"{path}.npy"}


def _passes(session: Any) -> int:
    session.UpdateStats()
    return int(session.GetStats().Get("stats.renderengine.pass").GetInt())


def _properties(values: Properties) -> Any:
    import pyluxcore

    made = pyluxcore.Properties()
    for key, value in values.items():
        made.Set(pyluxcore.Property(key, value))
    return made


if __name__ == "__main__":
    answer({"load": load, "render": render})
