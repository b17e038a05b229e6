"""Directions aimed at targets: bodies through which light arrives that light sampling cannot find; for one path or for eight.

Targets are lights enclosed in smooth glass, found when a scene is compiled, and bodies that its file marks `guide`
(renderer/scene/targets.py). A vertex in view of a target samples its direction from a mixture: a quarter of the time uniformly
over the solid angle of a sphere about a target, else by the BSDF (one-sample model, Veach, "Robust Monte Carlo Methods for Light
Transport Simulation", 1997, 9.2.4). The density of the mixture takes the place of the BSDF's in all MIS weights, so light
sampling goes on as without targets. A larger share finds directly lit points better, and what these light worse, since the
weights of other directions, 1 / (1 - share), multiply along a path (docs/performance.md has figures).

A target is chosen in proportion to its strength over its squared distance. It is not in view from within its guard sphere, which
contains all of the glass, nor if it lies behind an opaque surface. Compiled only for scenes with targets.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.arrays.light_rows import (
    TARGET_CENTER,
    TARGET_GUARD,
    TARGET_GUARD2,
    TARGET_RADIUS,
    TARGET_STRENGTH,
)
from renderer.arrays.rows import CLEAR
from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.material.material import has_flag
from renderer.kernel.options import MIS
from renderer.kernel.sampling.sphere_cone import sample_sphere_direction, sphere_direction_pdf
from renderer.kernel.steps.state import BsdfSample
from renderer.wide.values import any_of, as_wide, not_, where, where3, zero_like

__all__ = [
    "NOT_AIMED",
    "Aim",
    "Targets",
    "aim",
    "aimed_sample",
    "mixed_sample",
    "mixture_pdf",
    "targets_in_view",
    "unguided_factor",
]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
NOT_AIMED = np.float32(-1.0)  # in place of a target's number
_SHARE = np.float32(0.25)  # probability of aiming where a target is in view
_LEAST = np.float32(1e-30)
_MAX_FACTOR = np.float32(1e6)  # of the factor for roulette
_FIRST = np.uint32(0)
_CLEAR = np.uint32(CLEAR)


class Targets(NamedTuple):
    """The targets in view of a vertex."""

    total: Any  # sum of their strengths over their squared distances
    chance: Any  # probability of aiming at one of them; 0 if none is in view


class Aim(NamedTuple):
    """A vertex's choice between aiming at a target and sampling its BSDF."""

    is_aimed: Any
    direction: Any  # towards the target, world space; any unit vector if not aimed
    target: Any  # the target's number, a float; NOT_AIMED if there is none
    choose: Any  # the random number that is left, in [0, 1), to choose a lobe of the BSDF


@device
def _vector(scene, k, column):
    return scene.target[k, column], scene.target[k, column + 1], scene.target[k, column + 2]


@device
def _weight(scene, k, last):
    """Returns the strength of target k over its squared distance from a LastVertex; 0 if it is not in targets."""
    center, guard, radius = _vector(scene, k, TARGET_CENTER), _vector(scene, k, TARGET_GUARD), scene.target[k, TARGET_RADIUS]
    to_center, to_guard = vec.sub(center, last.point), vec.sub(guard, last.point)
    square = vec.dot(to_center, to_center)
    is_outside = vec.dot(to_guard, to_guard) > scene.target[k, TARGET_GUARD2]
    is_above = vec.dot(last.normal, to_center) >= -radius
    return where(is_outside & is_above, scene.target[k, TARGET_STRENGTH] / max(square, radius * radius), zero_like(square))


@device
def targets_in_view(scene, last, material, is_specular, is_surface, options):
    """Returns the Targets in view of a vertex.

    last: the vertex as a LastVertex. material: its number. is_surface: False for a vertex in a medium. Vertices on smooth glass
    and on mirrors do not aim, and strategies other than MIS do not.
    """
    total = zero_like(last.point[0])
    if options.sampling == MIS:
        for k in range(len(scene.target)):
            total = total + _weight(scene, k, last)
        is_clear = has_flag(scene, where(is_surface, material, _FIRST), _CLEAR) & is_surface
        total = where(is_clear | is_specular, zero_like(total), total)
    return Targets(total, where(total > _ZERO, zero_like(total) + _SHARE, zero_like(total)))


@device
def _targets_pdf(scene, last, targets, d, sampled):
    """Returns the pdf, per steradian, with which a vertex that aims samples the unit direction d.

    sampled: the number of the target for which d was sampled, as in Aim.
    """
    pdf = zero_like(targets.total)
    for k in range(len(scene.target)):
        center, radius = _vector(scene, k, TARGET_CENTER), as_wide(scene.target[k, TARGET_RADIUS], pdf)
        own = sphere_direction_pdf(center, radius, last.point, d, sampled == np.float32(k))
        weight = _weight(scene, k, last)
        pdf = pdf + where(weight > _ZERO, weight * own, zero_like(own))
    return pdf / max(targets.total, _LEAST)


@device
def mixture_pdf(scene, last, targets, d, bsdf_pdf, sampled):
    """Returns the pdf, per steradian, of the unit direction d by the mixture of a vertex's BSDF and its targets.

    bsdf_pdf: of d by the BSDF alone. sampled: as in Aim.
    """
    pdf = bsdf_pdf
    if any_of(targets.chance > _ZERO):
        mixed = (_ONE - targets.chance) * bsdf_pdf + targets.chance * _targets_pdf(scene, last, targets, d, sampled)
        pdf = where(targets.chance > _ZERO, mixed, bsdf_pdf)
    return pdf


@device
def aim(scene, last, targets, choose, u):
    """Decides at random whether a vertex aims, and samples the direction towards a target; returns an Aim.

    choose: the random number for the choice of a lobe. u: two numbers for the direction.
    """
    none = zero_like(choose)
    is_aimed = choose < targets.chance
    left = where(is_aimed, choose / max(targets.chance, _LEAST), (choose - targets.chance) / (_ONE - targets.chance))
    left = min(left, _ONE - np.float32(2.0**-24))
    direction, target = (none, none, none + _ONE), none + NOT_AIMED
    if any_of(is_aimed):
        center, radius, at, is_chosen = (none, none, none), none + _ONE, left * targets.total, none != none
        for k in range(len(scene.target)):
            weight = _weight(scene, k, last)
            here = not_(is_chosen) & (weight > _ZERO)  # the last one in view if none is reached, by rounding
            x, y, z = _vector(scene, k, TARGET_CENTER)
            center = where3(here, (none + x, none + y, none + z), center)
            radius = where(here, none + scene.target[k, TARGET_RADIUS], radius)
            target = where(here & is_aimed, none + np.float32(k), target)
            is_chosen = is_chosen | (here & (at < weight))
            at = at - weight
        towards, _ = sample_sphere_direction(center, radius, last.point, u)
        direction = where3(is_aimed, towards, direction)
    return Aim(is_aimed, direction, target, left)


@device
def unguided_factor(pdf, bsdf_pdf):
    """Returns the field `unguided` of the BsdfSample for a direction that was sampled with another pdf than the BSDF's."""
    return min(pdf / max(bsdf_pdf, _LEAST), _MAX_FACTOR)


@device
def mixed_sample(chance, is_other, sample, wi, f, own, pdf):
    """Returns the BsdfSample of a one-sample mixture of a BSDF and another distribution of directions.

    chance: probability of sampling the other distribution. is_other: whether it was sampled. sample: the BSDF's. wi: the other
    distribution's direction in the shading frame. f: f |cos| for wi. own, pdf: of the direction sampled, by the BSDF alone and by
    the mixture.
    """
    is_discrete = not_(is_other) & (sample.pdf == _ZERO)
    scale = where(is_discrete, _ONE / (_ONE - chance), sample.pdf / max(pdf, _LEAST))
    return BsdfSample(
        where3(is_other, wi, sample.wi),
        where3(is_other, vec.scale(f, _ONE / max(pdf, _LEAST)), vec.scale(sample.weight, scale)),
        where(is_discrete, zero_like(pdf), pdf),
        where(is_other, zero_like(pdf) + _ONE, sample.eta2),
        where(is_discrete, _ONE - chance, unguided_factor(pdf, own)),
    )


@device
def aimed_sample(scene, last, targets, chosen, frame, sample, wi, f, bsdf_pdf):
    """Returns the BsdfSample of the mixture.

    chosen: the vertex's Aim. sample: the BSDF's, for a vertex that does not aim. wi: the aimed direction in the shading frame.
    f, bsdf_pdf: f |cos| and the BSDF's pdf for wi.
    """
    if any_of(targets.chance > _ZERO):
        s, t, n = frame
        own = where(chosen.is_aimed, bsdf_pdf, sample.pdf)
        d = where3(chosen.is_aimed, chosen.direction, vec.to_world(s, t, n, sample.wi))
        pdf = mixture_pdf(scene, last, targets, d, own, chosen.target)
        sample = mixed_sample(targets.chance, chosen.is_aimed, sample, wi, f, own, pdf)
    return sample
