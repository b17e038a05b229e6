"""Decides which emission a path must not add, since manifold sampling (`estimate_caustic`) has already sampled that light.

A chain is the sequence of smooth interfaces of casters that a path has crossed since its last vertex at which `estimate_caustic`
samples. If a path hits a small lamp behind a chain of a kind that is sampled there, the lamp's emission is not added; all other
emission is. Kinds (walk.py) that are sampled are one reflection or transmission at a caster, except into a closed one; the
transmissions into a closed caster and out of it; and the long kinds that photons have found (`CausticTables.is_long`). A chain
ends where the path passes through a surface by alpha, at every other surface, where a shading normal had to be turned towards the
viewer, and after six interfaces.

The state of a chain is an integer: its sequence of interfaces, as in walk.py; from bit 8 on the number of the first caster; and
two marks.
"""

from __future__ import annotations

import numpy as np

from renderer.arrays.rows import DIFFUSE, MEDIUM
from renderer.jit import device
from renderer.kernel.manifold.caster import caster_of, caster_point
from renderer.kernel.manifold.walk import CODES

__all__ = ["BEGUN", "NO_CHAIN", "begin_chain", "continue_chain", "is_joined", "is_sampled_elsewhere"]

NO_CHAIN, BEGUN = np.int32(0), np.int32(1)
_SEQUENCE, _CASTER, _CASTERS = np.int32(CODES - 1), np.int32(8), np.int32(63)
_SHORT = np.int32(1 << 16)  # mark of a whole chain of a short kind
_ENTERED = np.int32(1 << 17)  # mark of a chain that has just entered a closed caster, its first
_UNMARKED = np.int32(0)
_MOST = np.int32(CODES // 2)  # sequences from here on have the greatest number of interfaces
_DIFFUSE, _MEDIUM = np.int32(DIFFUSE), np.int32(MEDIUM)
_LEAST_ROUGHNESS = np.float32(0.3)


@device
def is_joined(material):
    """Returns True if manifold sampling joins at a vertex: its material is diffuse, or rough enough for all its lobes to be wide.

    The BSDF finds lamps behind interfaces better from glossy surfaces.
    """
    return material.kind == _DIFFUSE or (material.kind != _MEDIUM and material.roughness >= _LEAST_ROUGHNESS)


@device
def begin_chain(material, specular):
    """Returns the state of the chain that begins at a vertex that is not specular."""
    return BEGUN if not specular and is_joined(material) else NO_CHAIN


@device
def continue_chain(scene, chain, hit, o, d, bounce):
    """Returns the state of a chain after a specular vertex. hit: the Hit by the ray o + t d; bounce: the Bounce there."""
    sequence = chain & _SEQUENCE
    if sequence == NO_CHAIN or sequence >= _MOST or (chain & _SHORT != 0 and len(scene.caustics.long_kind) == 0):
        return NO_CHAIN
    caster = caster_of(scene, hit)
    if caster < 0 or not bounce.has_left:
        return NO_CHAIN
    at = caster_point(scene, o, d, hit)
    if not at.regular:
        return NO_CHAIN
    first, mark = (chain >> _CASTER) & _CASTERS, _UNMARKED
    if sequence == BEGUN:
        enters = not bounce.reflected and at.front and scene.caustics.caster[caster, 2] != 0
        first, mark = caster, _ENTERED if enters else _SHORT
    elif chain & _ENTERED != 0 and not bounce.reflected and not at.front and caster == first:
        mark = _SHORT
    sequence = np.int32(2 * sequence + (1 if bounce.reflected else 0))
    return np.int32(sequence + (first << _CASTER) + mark)


@device
def is_sampled_elsewhere(scene, chain, light):
    """Returns True if manifold sampling has already sampled the emission that a path hits. light: index of the light."""
    tables = scene.caustics
    if chain <= BEGUN or tables.is_covered[light] == 0:
        return False
    return chain & _SHORT != 0 or tables.is_long[(chain >> _CASTER) & _CASTERS, chain & _SEQUENCE] != 0
