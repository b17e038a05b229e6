"""A path's first hit in an array of the caller's: carried through the integrator's loop as values, it would take registers."""

from __future__ import annotations

import numpy as np

from renderer.jit import device
from renderer.kernel.steps.record_first_hit import no_hit
from renderer.kernel.steps.state import FirstHit
from renderer.wide.fields import Layout, accessors

__all__ = ["FIRST_HIT_SLOTS", "forget_first_hit", "load_first_hit", "store_first_hit"]

_LAYOUT = Layout(FirstHit)
FIRST_HIT_SLOTS = _LAYOUT.width
_gather, _scatter = accessors(_LAYOUT)
_ONLY = np.uintp(0)
_ZERO = np.float32(0.0)


@device
def forget_first_hit(first):
    """Clears the array, (FIRST_HIT_SLOTS,) float32, as for a path that hits nothing."""
    _scatter(first, _ONLY, no_hit(_ZERO))


@device
def store_first_hit(first, hit):
    """Stores a FirstHit."""
    _scatter(first, _ONLY, hit)


@device
def load_first_hit(first):
    """Returns the stored FirstHit."""
    return _gather(first, _ONLY, FirstHit)
