"""The frame that jobs render while faults are injected, and the digest that it has without faults."""

from __future__ import annotations

from functools import cache
from typing import Any

from renderer.film import digest
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.load import read
from renderer.settings import RenderSettings, View
from tests.helpers import ROOT

__all__ = ["SCENE", "digest_alone", "request"]

SCENE = ROOT / "scenes" / "cornell-box.yaml"
VIEW = View((0, 0, 3.9), (0, 0, 0), (0, 1, 0), 39.3077)
WIDTH, HEIGHT, DEPTH = 96, 80, 5


def request(spp: int, seed: int) -> dict[str, Any]:
    """Returns the JSON fields of a request for the frame with this number of samples per pixel and this seed."""
    view = {"eye": VIEW.eye, "target": VIEW.target, "up": VIEW.up, "fov": VIEW.fov}
    return {"view": view, "width": WIDTH, "height": HEIGHT, "max_depth": DEPTH, "spp": spp, "seed": seed}


@cache
def digest_alone(spp: int, seed: int) -> str:
    """Returns the digest of the same frame rendered in this process without a farm."""
    scene = compile_scene(read(SCENE.parent, SCENE.name))
    return digest(render_frame(scene, RenderSettings(WIDTH, HEIGHT, VIEW, max_depth=DEPTH, seed=seed), spp, threads=2))
