"""Limits on the number of a path's bounces by kind, besides the limit on its segments; for one path or for eight lanes.

A path counts its diffuse reflections, glossy reflections, transmissions, and surfaces that it passes by their alpha. A reflection
is diffuse if its pdf is at most the maximum of a cosine lobe, 1 / pi per steradian; it is glossy if the pdf is greater, or if the
direction is discrete, as for a mirror. Not counted are vertices in a medium, boundaries of media and lamps without a body.
"""

from __future__ import annotations

import math

import numpy as np

from renderer.arrays.rows import INTERFACE, LAMP, TRANSPARENT
from renderer.jit import device
from renderer.wide.values import lookup, not_, u32, where

__all__ = [
    "DIFFUSE_LIMIT",
    "GLOSSY_LIMIT",
    "NO_COUNTS",
    "TRANSMISSION_LIMIT",
    "count_bounce",
    "is_blocked",
    "is_layer",
    "layers_left",
    "limit_of",
    "reached_limit",
    "with_layer",
]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_NONE = np.uint32(0)
_LAMBERT = np.float32(1.0001 / math.pi)
_INTERFACE, _LAMP, _TRANSPARENT = np.uint32(INTERFACE), np.uint32(LAMP), np.uint32(TRANSPARENT)
NO_COUNTS = (_ZERO, _ZERO, _ZERO, _ZERO)  # diffuse, glossy, transmissions, surfaces passed by alpha
DIFFUSE_LIMIT, GLOSSY_LIMIT, TRANSMISSION_LIMIT = 1.0, 2.0, 3.0


@device
def count_bounce(counts, left, reflected, pdf):
    """Returns the counts after a bounce.

    left: whether the ray has left its facet. reflected: else transmitted. pdf: that of the whole material; 0 for a discrete
    direction.
    """
    diffuse, glossy, transmitted, layers = counts
    is_glossy = reflected & ((pdf > _LAMBERT) | (pdf == _ZERO))
    is_diffuse = reflected & not_(is_glossy)
    return (
        diffuse + where(left & is_diffuse, _ONE, _ZERO),
        glossy + where(left & is_glossy, _ONE, _ZERO),
        transmitted + where(left & not_(reflected), _ONE, _ZERO),
        layers,
    )


@device
def reached_limit(counts, options):
    """Returns True if a limit on bounces is reached: the path ends at the next surface, after adding its emission."""
    diffuse, glossy, transmitted, _ = counts
    return (diffuse >= options.diffuse_depth) | (glossy >= options.glossy_depth) | (transmitted >= options.transmission_limit)


@device
def limit_of(counts, options):
    """Returns the limit that makes `reached_limit` True for one path; 0: none."""
    diffuse, glossy, transmitted, _ = counts
    limit = TRANSMISSION_LIMIT if transmitted >= options.transmission_limit else 0.0
    limit = GLOSSY_LIMIT if glossy >= options.glossy_depth else limit
    return DIFFUSE_LIMIT if diffuse >= options.diffuse_depth else limit


@device
def is_layer(scene, material):
    """Returns True if a surface that a ray passes is counted: one passed by its alpha, no media boundary or bodiless lamp."""
    flags = u32(lookup(scene.material_flags, material))
    is_boundary = u32(lookup(scene.material_kind, material)) == _INTERFACE
    return not_(is_boundary) & ((flags & _TRANSPARENT) != _NONE) & ((flags & _LAMP) == _NONE)


@device
def with_layer(scene, material, counts):
    """Returns the path's depth counts (one per kind) after passing through a surface of this material."""
    diffuse, glossy, transmitted, layers = counts
    return diffuse, glossy, transmitted, layers + where(is_layer(scene, material), _ONE, _ZERO)


@device
def layers_left(counts, options):
    """Returns the number of layers that the path and its shadow rays may still pass; infinite without a limit."""
    return options.transparency_depth - counts[3]


@device
def is_blocked(scene, material, counts, options):
    """Returns True if the path ends at a surface through which it would pass, because no more layers may be passed."""
    return is_layer(scene, material) & (layers_left(counts, options) < _ONE)
