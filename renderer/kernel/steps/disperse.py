"""Dispersion: at a dispersive material a path continues with a single colour channel."""

from __future__ import annotations

import numpy as np

from renderer.arrays.rows import DISPERSIVE
from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.material.material import colored_index, has_flag
from renderer.kernel.steps.random_blocks import draw_color
from renderer.wide.lanes import each_lane
from renderer.wide.values import any_of, where, where3

__all__ = ["disperse"]

_ZERO = np.float32(0.0)
_DISPERSIVE = np.uint32(DISPERSIVE)


@device
def disperse(scene, surface, ior, throughput, wanted, stream, number):
    """Returns (index of refraction, throughput), reduced to a single colour channel if the material is dispersive.

    wanted: False leaves both unchanged. ior: the material's index. number: count of earlier vertices.
    """
    if scene.has.layers is not None:
        spread = wanted & has_flag(scene, surface.material, _DISPERSIVE) & (vec.maximum(throughput) > _ZERO)
        if any_of(spread):
            u = draw_color(stream, number)
            own, seen = each_lane(colored_index, spread, (scene, surface.material, throughput, u))
            ior, throughput = where(spread, own, ior), where3(spread, seen, throughput)
    return ior, throughput
