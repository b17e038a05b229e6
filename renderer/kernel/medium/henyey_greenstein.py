"""The phase function of Henyey & Greenstein, "Diffuse Radiation in the Galaxy" (1941).

The third axis of the local frame points against the direction of travel, as the viewer's direction does at a surface: forward
scattering is -z. For one path or for eight lanes.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.jit import device
from renderer.kernel.polynomial import sincos_turns

__all__ = ["eval_henyey_greenstein", "pdf_henyey_greenstein", "sample_henyey_greenstein"]

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_INV_4PI = np.float32(0.25 / math.pi)


@device
def pdf_henyey_greenstein(g, wi):
    """Returns the pdf of direction wi, per steradian. g: mean cosine of the scattering angle, -1 < g < 1."""
    narrow = _ONE - g
    square = narrow * narrow + _TWO * g * (_ONE + wi[2])  # 1 + g**2 - 2 g cosine
    return _INV_4PI * (_ONE - g * g) / (square * math.sqrt(square))


@device
def eval_henyey_greenstein(g, wi):
    """Returns the phase function for direction wi, per steradian. It equals the pdf, since it is sampled exactly."""
    return pdf_henyey_greenstein(g, wi)


@device
def sample_henyey_greenstein(g, u):
    """Samples a local direction wi by the inverse CDF, rearranged to avoid the division by g: valid for g = 0."""
    k = (_ONE - g - _TWO * u[0]) / (_ONE - g + _TWO * g * u[0])
    cosine = min(max(_HALF * g - k - _HALF * g * k * k, -_ONE), _ONE)
    radius = math.sqrt(max(_ONE - cosine * cosine, _ZERO))
    sine, cosine_of_turn = sincos_turns(u[1])
    return radius * cosine_of_turn, radius * sine, -cosine
