"""Multiple importance sampling: the power heuristic, and the weights of BSDF sampling and light sampling.

Veach, "Robust Monte Carlo Methods for Light Transport Simulation" (1997), 9.2.
"""

from __future__ import annotations

import numpy as np

from renderer.jit import device
from renderer.wide.values import where, zero_like

__all__ = ["LEAST_PDF", "MOST_PDF", "branches_to_light", "hit_weight", "light_weight", "power_heuristic"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
LEAST_PDF, MOST_PDF = np.float32(1e-18), np.float32(1e18)  # bounds whose squares fit float32


@device
def power_heuristic(a, b):
    """Returns the MIS weight, with exponent 2, of a sample with density a > 0 where the other strategy has density b."""
    a = min(max(a, LEAST_PDF), MOST_PDF)
    b = min(b, MOST_PDF)
    return a * a / (a * a + b * b)


@device
def hit_weight(pdf, light_pdf):
    """Returns the MIS weight of light that a path hits; 1 if light sampling cannot find it.

    pdf: of the ray's direction by BSDF sampling, 0 for a discrete direction. light_pdf: of the same direction by light sampling.
    """
    return where(pdf > _ZERO, power_heuristic(pdf, light_pdf), _ONE)


@device
def branches_to_light(alone, number, options):
    """Returns the number of directions scattered at a vertex that can hit the sampled light, for the light's MIS weight.

    alone: whether rays cannot hit the light; the result is then 0. number: count of earlier vertices.
    """
    none = zero_like(number)
    return where(alone, none, where(number == _ZERO, none + np.float32(options.splitting), _ONE))


@device
def light_weight(light_pdf, scatter_pdf, branches):
    """Returns the MIS weight of a light sample. branches: from `branches_to_light`; if it is 0, the weight is 1."""
    return where(branches == _ZERO, _ONE, power_heuristic(light_pdf, branches * scatter_pdf))
