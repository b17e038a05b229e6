"""Paint under a rough coat, as Mitsuba's roughplastic has it: it loses some of the light between paint and coat.

The numbers are the albedo of its `roughplastic` over that of its `plastic`, head on, of grey paint without the coat's reflection,
as Mitsuba 3.9 evaluates both.
"""

from __future__ import annotations

import numpy as np

__all__ = ["rough_coat"]

_ALPHAS = (0.0, 0.02, 0.05, 0.1, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0)
_LEFT = {
    1.0: (1.0,) * 10,
    1.33: (1.0, 0.982, 0.967, 0.927, 0.830, 0.743, 0.671, 0.565, 0.488, 0.427),
    1.49: (1.0, 0.973, 0.955, 0.906, 0.790, 0.686, 0.603, 0.484, 0.403, 0.341),
    1.8: (1.0, 0.956, 0.931, 0.865, 0.716, 0.591, 0.497, 0.371, 0.291, 0.235),
}


def rough_coat(ior: float, alpha: float) -> float:
    """The share of a smooth coat's light that comes out of a rough one, 0 to 1. alpha: of its facets."""
    rows = [float(np.interp(alpha, _ALPHAS, row)) for row in _LEFT.values()]
    return float(np.interp(ior, list(_LEFT), rows))
