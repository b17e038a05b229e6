"""The primitives towards which `sampling: mixture` samples directions: lights, and spheres that the scene marks."""

from __future__ import annotations

import numpy as np

from renderer.scene.description import F32, I32

__all__ = ["MAX_GUIDES", "list_guides"]

MAX_GUIDES = 64  # at each bounce the pdf of every target is evaluated


def list_guides(marked: list[bool], light_primitive: I32, second: I32, light_cdf: F32, triangles: int) -> I32:
    """Returns the target primitives, (G,) i32: the marked spheres, then the strongest emitting primitives; at most MAX_GUIDES.

    marked: whether each sphere is marked. light_primitive, light_cdf: as in CompiledScene. second: each light's second triangle,
    or -1. Punctual lights are no targets.
    """
    spheres = triangles + np.flatnonzero(marked).astype(np.int32)
    bodies = light_primitive < triangles + len(marked)
    strongest = np.argsort(-np.diff(light_cdf)[bodies], kind="stable")
    lights = np.stack([light_primitive, second], axis=1)[bodies][strongest].ravel()
    lights = lights[lights >= 0]
    return np.concatenate([spheres, lights[~np.isin(lights, spheres)]])[:MAX_GUIDES].astype(np.int32)
