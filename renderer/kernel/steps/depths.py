"""Limits on the number of a path's bounces by kind, besides the limit on its segments; for one path or for eight lanes.

A path counts its diffuse reflections, glossy reflections, transmissions, and surfaces that it passes by their alpha ("layers"). A
reflection is diffuse if its pdf is at most the maximum of a cosine lobe, 1 / pi per steradian; it is glossy if the pdf is
greater, or if the direction is discrete, as for a mirror. Vertices in a medium, boundaries of media and lamps without a body are
not counted.
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
    """Returns a path's depth counts (diffuse, glossy, transmissions, layers) after a bounce.

    left: whether the ray has left its facet; otherwise the bounce is not counted. reflected: False for a transmission. pdf: of
    the whole material; 0 for a discrete direction.
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
    """Returns True if a path's depth counts have reached a limit.

    The path then ends at the next surface, after the emission of that surface is added.
    """
    diffuse, glossy, transmitted, _ = counts
    return (diffuse >= options.diffuse_depth) | (glossy >= options.glossy_depth) | (transmitted >= options.transmission_limit)


@device
def limit_of(counts, options):
    """Returns which limit one path's depth counts have reached: DIFFUSE_LIMIT, GLOSSY_LIMIT or TRANSMISSION_LIMIT; 0: none."""
    diffuse, glossy, transmitted, _ = counts
    limit = TRANSMISSION_LIMIT if transmitted >= options.transmission_limit else 0.0
    limit = GLOSSY_LIMIT if glossy >= options.glossy_depth else limit
    return DIFFUSE_LIMIT if diffuse >= options.diffuse_depth else limit


@device
def is_layer(scene, material):
    """Returns True if passing through a surface of this material counts as a layer: if it is transparent by its alpha.

    Boundaries of media and lamps without a body are not counted.
    """
    flags = u32(lookup(scene.material_flags, material))
    is_boundary = u32(lookup(scene.material_kind, material)) == _INTERFACE
    return not_(is_boundary) & ((flags & _TRANSPARENT) != _NONE) & ((flags & _LAMP) == _NONE)


@device
def with_layer(scene, material, counts):
    """Returns a path's depth counts, one per kind of bounce, after the path has passed through a surface of this material."""
    diffuse, glossy, transmitted, layers = counts
    return diffuse, glossy, transmitted, layers + where(is_layer(scene, material), _ONE, _ZERO)


@device
def layers_left(counts, options):
    """Returns how many more surfaces with alpha the path and its shadow rays may pass; infinite without a limit.

    counts: the path's depth counts.
    """
    return options.transparency_depth - counts[3]


@device
def is_blocked(scene, material, counts, options):
    """Returns True if a path ends at a surface that it would otherwise pass through by alpha, since it has passed too many."""
    return is_layer(scene, material) & (layers_left(counts, options) < _ONE)
