"""Perfect specular reflection by a mirror."""

from __future__ import annotations

from renderer.jit import device

__all__ = ["sample_mirror"]


@device
def sample_mirror(reflectance, wo):
    """Returns (wi, weight) of a mirror: the local mirror direction and the reflectance."""
    return (-wo[0], -wo[1], wo[2]), reflectance
