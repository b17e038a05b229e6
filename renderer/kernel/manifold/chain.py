"""Decides which emission a path must not add, since manifold sampling (`estimate_caustic`) has already sampled that light.

A chain is the sequence of smooth interfaces of casters that a path has crossed since its last vertex at which `estimate_caustic`
samples. If a path hits a small lamp behind a complete chain, the lamp's emission is not added; all other emission is. A chain is
complete after one reflection or transmission at a caster. If the path enters a closed caster, the chain is complete once the path
has left it again. A chain ends where the path passes through a surface by alpha, at every other surface, and where a shading
normal had to be turned towards the viewer.
"""

from __future__ import annotations

import numpy as np

from renderer.arrays.rows import DIFFUSE, MEDIUM
from renderer.jit import device
from renderer.kernel.manifold.caster import caster_of, caster_point
from renderer.wide.values import lookup, u32

__all__ = ["BEGUN", "NO_CHAIN", "begin_chain", "continue_chain", "is_joined", "is_sampled_elsewhere"]

NO_CHAIN, BEGUN, _WHOLE, _ENTERED = (np.int32(n) for n in (0, 1, 2, 3))  # from _ENTERED on: + the number of a closed caster
_DIFFUSE, _MEDIUM = np.int32(DIFFUSE), np.int32(MEDIUM)
_WHOLE_BITS, _UNCOVERED = np.uint32(_WHOLE), np.uint32(0)
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
    if chain == NO_CHAIN or chain == _WHOLE:  # noqa: SIM109 -- kernels compare integers one by one
        return NO_CHAIN
    caster = caster_of(scene, hit)
    if caster < 0 or not bounce.has_left:
        return NO_CHAIN
    at = caster_point(scene, o, d, hit)
    if not at.regular:
        return NO_CHAIN
    if chain >= _ENTERED:
        leaves = not bounce.reflected and not at.front and caster == chain - _ENTERED
        return _WHOLE if leaves else NO_CHAIN
    if bounce.reflected or not at.front or scene.caustics.caster[caster, 2] == 0:
        return _WHOLE
    return np.int32(_ENTERED + caster)


@device
def is_sampled_elsewhere(scene, chain, light):
    """Returns True if manifold sampling has already sampled the emission that a path hits; for one path or for eight lanes.

    light: index of the light.
    """
    return (u32(chain) == _WHOLE_BITS) & (u32(lookup(scene.caustics.is_covered, light)) != _UNCOVERED)
