"""Rayfarm and Mitsuba behind the same interface: each is given a scene, and renders pictures of a sample count and a seed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from renderer.film import mean
from renderer.render import RenderStats, render_frame
from renderer.scene.compile import compile_scene
from tests.benchmarks.peers.scenes import Case
from tests.benchmarks.peers.surroundings import mitsuba_with_llvm
from tests.peers.mitsuba_scene import mitsuba_dict

__all__ = ["Mitsuba", "Rayfarm", "converged"]

_AT_ONCE = 256  # samples per pixel of each part of a reference picture


class Rayfarm:
    """A scene prepared for Rayfarm, which renders with its default sampler (scrambled Sobol')."""

    def __init__(self, case: Case, pixels: int, **more: Any) -> None:
        self.scene = compile_scene(case.description)
        self.settings = case.settings(pixels, **more)
        self.stats = RenderStats()

    def picture(self, spp: int, seed: int, threads: int | None = None) -> np.ndarray:
        """Renders the scene, and returns the picture (h, w, 3). spp: samples per pixel."""
        settings = replace(self.settings, seed=seed)
        return mean(render_frame(self.scene, settings, spp, threads, stats=self.stats), settings.film_exponent)


class Mitsuba:
    """A scene prepared for Mitsuba with its fastest settings.

    These are LLVM's vectorisation on all cores, Russian roulette, one-sided surfaces and shared materials.
    """

    def __init__(self, case: Case, pixels: int, sampler: str, folder: Path) -> None:
        self.mi = mitsuba_with_llvm()
        settings = case.settings(pixels)
        made = mitsuba_dict(self.mi, case.twin or case.description, settings, folder)
        made["integrator"] = {"type": "path", "max_depth": settings.max_depth}
        made["sensor"]["sampler"] = {"type": sampler}
        made = _share_materials(made)
        if case.theirs is not None:
            case.theirs(self.mi, made)
        self.scene = self.mi.load_dict(made)

    def picture(self, spp: int, seed: int) -> np.ndarray:
        """Renders the scene, and returns the picture (h, w, 3). spp: samples per pixel."""
        return np.array(self.mi.render(self.scene, spp=spp, seed=seed))


def converged(picture: Callable[[int, int], np.ndarray], spp: int) -> np.ndarray:
    """Calls `picture` with different seeds, for `spp` samples per pixel in all; returns the mean picture."""
    parts = max(1, spp // _AT_ONCE)
    return np.mean([picture(min(spp, _AT_ONCE), 1000 + part) for part in range(parts)], axis=0)


def _share_materials(made: dict[str, Any]) -> dict[str, Any]:
    """Returns Mitsuba's scene dictionary with each material defined only once, and referred to by its shapes.

    Two-sided materials become one-sided, since no view shows a back face.
    """
    names: dict[int, str] = {}
    scene: dict[str, Any] = {}
    for key, part in made.items():
        if isinstance(part, dict) and isinstance(part.get("bsdf"), dict):
            material = part["bsdf"]
            if id(material) not in names:
                names[id(material)] = f"bsdf{len(names)}"
                scene[names[id(material)]] = material["bsdf"] if material["type"] == "twosided" else material
            part["bsdf"] = {"type": "ref", "id": names[id(material)]}
        scene[key] = part
    return scene
