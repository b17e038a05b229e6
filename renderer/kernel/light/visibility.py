"""Visibility of lights: which kinds of rays see a light, and which objects block it (shadow linking).

A light's word in `light_visibility` has a bit for each kind of ray that sees it, and the number of the root node for its shadow
rays (LIGHT_ROOT_BIT in renderer/arrays/rows.py). Objects that do not block a light with a shadow link stop the rays that would
hit it. So only light sampling finds such a light, without MIS; hits count after discrete directions, and for the camera.
"""

from __future__ import annotations

import numpy as np

from renderer.arrays.rows import LIGHT_ROOT_BIT, SEEN_BY_ALL
from renderer.bvh.layout import RAY_KINDS
from renderer.jit import device
from renderer.kernel.light.light_sample import LightSample
from renderer.wide.values import as_wide, lookup, not_, u32, where

__all__ = ["counts_when_hit", "is_seen", "sampled_visibility", "shadow_root_of", "with_visibility"]

_BIT, _NOTHING, _FIRST = np.uint32(1), np.uint32(0), np.uint32(0)
_ROOT_BIT, _SEEN_BY_ALL = np.uint32(LIGHT_ROOT_BIT), np.uint32(SEEN_BY_ALL)
_SHADOW = np.uint32(RAY_KINDS.index("shadow"))
_ZERO = np.float32(0.0)


@device
def is_seen(word, kind):
    """Returns True if rays of a kind, an index into RAY_KINDS, see the light with this word."""
    return ((word >> kind) & _BIT) != _NOTHING


@device
def shadow_root_of(word):
    """Returns the index into `ray_roots` of the root node for shadow rays to the light with this word."""
    return word >> _ROOT_BIT


@device
def sampled_visibility(scene, choice, light):
    """Returns the word of a sampled light. choice, light: as for `sample_chosen`; all rays see the environment."""
    from_far = choice < scene.environment_frame[3]
    known = u32(lookup(scene.light_visibility, where(from_far, as_wide(_FIRST, choice), light)))
    return u32(where(from_far, as_wide(_SEEN_BY_ALL, choice), known))


@device
def with_visibility(sample, word):
    """Returns the LightSample of the light with this word, marked as found by light sampling alone if it has a shadow link."""
    alone = sample.alone | (shadow_root_of(word) != _SHADOW)
    return LightSample(sample.direction, sample.end, sample.radiance, sample.pdf, alone)


@device
def counts_when_hit(scene, light, pdf):
    """Returns True if the emission of light number `light` counts for a ray that hits it. pdf: of the Ray."""
    word = u32(lookup(scene.light_visibility, light))
    return not_(pdf > _ZERO) | (shadow_root_of(word) == _SHADOW)
