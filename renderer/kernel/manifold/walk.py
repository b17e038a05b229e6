"""Newton's method for the direction in which light from a lamp's point reaches a vertex through casters.

A kind of chain is the sequence of its interfaces from the vertex to the lamp, as an integer: a 1, then a bit for each interface,
which is 1 for reflection. Short kinds have one interface, or two where light crosses a closed caster; all others are long, and
marked by LONG.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.arrays.rows import ABSORBING, ABSORPTION, BASE, COLUMNS, MIRROR
from renderer.bvh.traverse import closest_hit
from renderer.jit import device, never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.bsdf.fresnel import fresnel_dielectric
from renderer.kernel.fetch import columns, row
from renderer.kernel.manifold.caster import CasterPoint, caster_of, caster_point, index_of, material_number
from renderer.kernel.manifold.differentials import (
    RayDerivatives,
    arrive,
    half_vector_step,
    leave_point,
    redirect,
)
from renderer.kernel.steps.pass_through import absorbed
from renderer.kernel.surface.ray_origins import leave, offset_ray_origin

__all__ = [
    "CODES",
    "LAST_STEP2",
    "LONG",
    "NO_CHAIN",
    "REFLECTED",
    "THROUGH",
    "TRANSMITTED",
    "Walk",
    "interface_count",
    "interface_weight",
    "last_out",
    "reflects_at",
    "walk_to_lamp",
]

# Kinds of chains: reflection, transmission, transmission into a closed caster and out of it.
NO_CHAIN, TRANSMITTED, REFLECTED, THROUGH = (np.int32(n) for n in (-1, 0b10, 0b11, 0b100))
CODES = 1 << 7  # of sequences of up to six interfaces
LONG = np.int32(CODES)
_SEQUENCE = np.int32(CODES - 1)  # mask of the sequence
_FIRST = np.int32(1)

_ZERO = np.float32(0.0)
_HALF = np.float32(0.5)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_INF = np.float32(np.inf)
_YES, _NO = np.bool_(True), np.bool_(False)
_BLACK = (_ZERO, _ZERO, _ZERO)
_ROOT = np.int32(0)
_MIRROR = np.int32(MIRROR)
_MOST_STEPS = 12
_LEAST_STEP = np.float32(1.0 / 64)
_TOLERANCE2 = np.float32(1e-8)  # squared difference of the two sides of Snell's law
LAST_STEP2 = np.float32(2.5e-7)  # squared change of the direction by one more step, at a solution
_RARE = np.float32(0.125)  # probability of THROUGH where the lamp is on the viewer's side of a mesh


class Walk(NamedTuple):
    """The end of a walk: whether it has reached a solution, and the chain of interfaces there."""

    found: Any
    kind: Any
    d: Any  # direction at the vertex, unit
    limit: Any  # the direction after one more step, computed without tracing it: equal for walks to the same solution
    at: Any  # the last interface's CasterPoint
    ray: Any  # RayDerivatives of the ray that arrives there
    p_u: Any  # derivatives of its point
    p_v: Any
    eta: Any
    weight: Any  # of the interfaces before the last one and of the absorption up to it, rgb
    material: Any  # number of the caster's material
    regular: Any  # whether no shading normal is bent
    rays: Any  # number of rays traced


@device
def interface_count(kind):
    """Returns the number of interfaces of a kind of chain."""
    count, rest = np.int32(0), kind & _SEQUENCE
    while rest > _FIRST:
        count, rest = np.int32(count + 1), np.int32(rest >> 1)
    return count


@device
def reflects_at(kind, following):
    """Returns True if a kind of chain is reflected at an interface. following: number of interfaces between it and the lamp."""
    return (kind >> np.int32(following)) & _FIRST != 0


@device
def interface_weight(scene, material, cosine, eta, reflects):
    """Returns the factor of radiance at a smooth interface, rgb: of BSDF sampling, its weight times its probability."""
    base = columns(scene.material, material, COLUMNS, BASE, 3)
    if scene.material_kind[material] == _MIRROR:
        return base
    reflectance, _ = fresnel_dielectric(cosine, eta)
    if reflects:
        return reflectance, reflectance, reflectance
    return vec.scale(base, (_ONE - reflectance) / (eta * eta))


@device
def _absorbed_before(scene, material, front, weight, start, end):
    """Returns the weight after absorption between two points; only rays that arrive at an interface's back were inside."""
    if scene.has.layers is not None and not front and scene.material_flags[material] & ABSORBING != 0:
        weight = absorbed(weight, columns(scene.material, material, COLUMNS, ABSORPTION, 3), start, end)
    return weight


@device
def _kind_of(scene, caster, at, target, is_distant, wanted, rates, u):
    """Returns the kind of chain that a walk from this first CasterPoint looks for; NO_CHAIN if the walk is to end here.

    wanted: the only kind of interest; NO_CHAIN for all, at the `rates` of transmission and of reflection.
    """
    to_lamp = target if is_distant else vec.sub(target, at.point)
    same_side = vec.dot(to_lamp, at.geometric) > _ZERO
    first, _, closed, transmits = row(scene.caustics.caster, caster, 4)
    if transmits == 0:
        return REFLECTED if same_side and (wanted != NO_CHAIN or u < rates[1]) else NO_CHAIN
    is_entry = closed != 0 and at.front
    kind = REFLECTED if same_side else (THROUGH if is_entry else TRANSMITTED)
    # Light through a sphere never comes from the viewer's side of its tangent plane.
    if same_side and is_entry and first < len(scene.triangle):
        kind = THROUGH if u < _RARE else REFLECTED
        u = u / _RARE if u < _RARE else (u - _RARE) / (_ONE - _RARE)
    if wanted == NO_CHAIN:
        return kind if u < (rates[1] if kind == REFLECTED else rates[0]) else NO_CHAIN
    return kind if kind == wanted else NO_CHAIN


@subroutine
def walk_to_lamp(scene, stack, surface, n, d, caster, target, is_distant, wanted, rates, last_step2, u):
    """Walks from direction d at a vertex towards a solution; returns a Walk.

    surface, n: of the vertex. caster: at the first interface; at all interfaces of a short kind. target: the lamp's point, or if
    `is_distant` the direction to it. wanted: a kind of chain, or NO_CHAIN for all short ones; rates: as for `_kind_of`.
    last_step2: the greatest squared change of the direction by one more step at a solution: LAST_STEP2, or infinite if d is known
    to be a solution. u: a random number in [0, 1) for the kind of chain. The interfaces before the last one obey the laws of
    reflection and refraction at each step; the walk solves for the last one.
    """
    never_inline()
    radius = row(scene.caustics.bound, caster, 4)[3]
    kind, count, step, rays = wanted, interface_count(wanted), _ONE, 0
    base, move = _BLACK, _BLACK
    at = CasterPoint(_BLACK, _ZERO, _BLACK, _BLACK, _NO, _NO, _ZERO, _BLACK, _BLACK, _BLACK, _BLACK)
    ray = RayDerivatives(d, _BLACK, _BLACK, _BLACK, _BLACK)
    p_u, p_v, eta, weight, regular = _BLACK, _BLACK, _ONE, (_ONE, _ONE, _ONE), _NO
    found, material = _NO, np.int32(0)
    limit = d
    for iteration in range(_MOST_STEPS):
        start, last_point = offset_ray_origin(surface, vec.dot(n, d) > _ZERO, d), surface.point
        ray, weight, regular = leave_point(d), (_ONE, _ONE, _ONE), _YES
        first_point, first_u, first_v = _BLACK, _BLACK, _BLACK
        good, number, crosses = _YES, np.int32(0), _NO
        while True:
            hit = closest_hit(scene.bvh, stack, start, ray.d, _INF, None, _ROOT)
            rays += 1
            own = caster_of(scene, hit)
            good = own == caster if number == 0 or kind < LONG else own >= 0
            if not good:
                break
            material = material_number(scene, hit.primitive)
            at = caster_point(scene, start, ray.d, hit)
            regular = regular and at.regular
            p_u, p_v = arrive(ray, hit.t, at.geometric)
            if number == 0:
                first_point, first_u, first_v = at.point, p_u, p_v
                if iteration == 0 and kind < LONG:
                    kind = _kind_of(scene, caster, at, target, is_distant, wanted, rates, u)
                    count = interface_count(kind)
                    if kind == NO_CHAIN:
                        break
                crosses = at.front and scene.caustics.caster[caster, 2] != 0
            elif kind == THROUGH or count == 2:
                crosses = crosses and own == caster and not at.front
                good = crosses if kind == THROUGH else not (crosses and (kind & _SEQUENCE) == THROUGH)
                if not good:
                    break
            eta = index_of(scene, material, at.front)
            weight = _absorbed_before(scene, material, at.front, weight, last_point, at.point)
            number = np.int32(number + 1)
            if number == count:
                break
            reflects = reflects_at(kind, count - number)
            weight = vec.mul(weight, interface_weight(scene, material, -vec.dot(ray.d, at.normal), eta, reflects))
            good, ray = redirect(ray, p_u, p_v, at, eta, reflects)
            good = good and (at.front or kind != THROUGH)
            if not good:
                break
            start, last_point = leave(at.point, at.error, at.geometric, ray.d), at.point
        if kind == NO_CHAIN:
            break
        if good:
            reflects = reflects_at(kind, 0)
            is_beyond, error2, by_u, by_v = half_vector_step(ray, p_u, p_v, at, eta, reflects, target, is_distant)
            base = first_point
            move = vec.add(vec.scale(first_u, by_u), vec.scale(first_v, by_v))
            if error2 < _TOLERANCE2:
                limit = vec.normalize(vec.sub(vec.add(base, move), surface.point))
                off = vec.sub(limit, d)
                # At the edge of a caustic the error is small, too, where there is no solution, but the next step is large.
                if vec.dot(off, off) < last_step2:
                    found = is_beyond
                    break
            far = vec.length(move)
            if not far < _INF:
                break
            if far > radius:
                move = vec.scale(move, radius / far)
            step = min(_ONE, _TWO * step)
        else:
            step *= _HALF
            if iteration == 0 or step < _LEAST_STEP:
                break
        d = vec.normalize(vec.sub(vec.add(base, vec.scale(move, step)), surface.point))
    return Walk(found, kind, d, limit, at, ray, p_u, p_v, eta, weight, material, regular, rays)


@device
def last_out(scene, walk, material):
    """Returns (whether there is such a ray, RayDerivatives of the ray towards the lamp, weight of all interfaces, rgb)."""
    reflects = reflects_at(walk.kind, 0)
    exists, out = redirect(walk.ray, walk.p_u, walk.p_v, walk.at, walk.eta, reflects)
    cosine = -vec.dot(walk.ray.d, walk.at.normal)
    own = interface_weight(scene, material, cosine, walk.eta, reflects)
    return exists, out, vec.mul(walk.weight, own)
