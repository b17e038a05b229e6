"""Dispersion: at a dispersive material a path continues with a single colour channel, or with its hero wavelength."""

from __future__ import annotations

import numpy as np

from renderer.arrays.rows import DISPERSIVE
from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.material.material import colored_index, has_flag, hero_index
from renderer.kernel.steps.random_blocks import draw_color
from renderer.wide.lanes import each_lane
from renderer.wide.values import any_of, where, where3, zero_like

__all__ = ["disperse"]

_ZERO = np.float32(0.0)
_THREE = np.float32(3.0)
_DISPERSIVE = np.uint32(DISPERSIVE)


@device
def disperse(scene, surface, ior, throughput, wanted, stream, number, wavelengths):
    """Returns (index of refraction, throughput), reduced to a single colour channel if the material is dispersive.

    wanted: False leaves both unchanged. ior: the material's index. number: count of earlier vertices. wavelengths: of the path,
    of which the hero remains, with the light of all three (Wilkie et al. 2014); None in RGB.
    """
    if scene.has.layers is not None:
        spread = wanted & has_flag(scene, surface.material, _DISPERSIVE) & (vec.maximum(throughput) > _ZERO)
        if any_of(spread):
            if scene.spectrum is not None:
                own = hero_index(scene, surface.material, ior, wavelengths)
                red, green, blue = throughput
                none = zero_like(red)
                alone = (green == _ZERO) & (blue == _ZERO)  # since an earlier surface
                seen = where(alone, red, _THREE * red), none, none
            else:
                u = draw_color(stream, number)
                own, seen = each_lane(colored_index, spread, (scene, surface.material, throughput, u))
            ior, throughput = where(spread, own, ior), where3(spread, seen, throughput)
    return ior, throughput
