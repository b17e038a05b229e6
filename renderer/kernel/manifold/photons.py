"""Photons that lamps send through casters: they show where caustics are.

A photon crosses the interfaces of one caster, as the short chains of `estimate_caustic` do, up to the next other surface; or up
to six interfaces of any casters, to find the long chains that are worth a walk. It need not be exact, since the estimator's mean
does not depend on it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.bvh.traverse import NO_PRIMITIVE, closest_hit
from renderer.jit import device, entry, never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.bsdf.fresnel import fresnel_dielectric
from renderer.kernel.fetch import row
from renderer.kernel.manifold.brightness import LEVELS, REFINEMENT, bucket_of
from renderer.kernel.manifold.caster import caster_of, caster_point, index_of, material_number
from renderer.kernel.manifold.differentials import arrive, leave_plane, leave_point, redirect
from renderer.kernel.manifold.lamps import AREA, DISTANT, lamp_light, sample_lamp
from renderer.kernel.manifold.walk import LONG, REFLECTED, THROUGH, TRANSMITTED, interface_weight
from renderer.kernel.sampling.sampler import INDEPENDENT, Stream, draw4, pixel_key
from renderer.kernel.sampling.warp import square_to_cone, square_to_cone_pdf, square_to_disk, square_to_disk_pdf, square_to_sphere
from renderer.kernel.surface.ray_origins import leave
from renderer.reference import by_reference

__all__ = [
    "ALL",
    "CASTER",
    "FLUX",
    "INTERFACE",
    "KIND",
    "LONG_COLUMNS",
    "PHOTON_COLUMNS",
    "PLACE",
    "REFLECTS",
    "Photon",
    "emission_pdf",
    "follow_caustic_photons",
    "follow_long_photons",
    "follow_photon",
    "kind_chance",
    "photon_buckets",
]

# Columns of a photon: where it arrives; its caster; 1 if that reflects it, else 0; its flux; where it leaves the caster; and its
# flux before it was divided between reflection and transmission.
PLACE, CASTER, REFLECTS, FLUX, INTERFACE, ALL = 0, 3, 4, 5, 6, 9
PHOTON_COLUMNS = 10
# Columns of a photon of a long chain: the same, of the caster that it leaves last, and the kind of its chain.
KIND, LONG_COLUMNS = 4, 9

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_INF = np.float32(np.inf)
_PI = np.float32(np.pi)
_TWO = np.float32(2.0)
_4PI = np.float32(4 * np.pi)
_BLACK = (_ZERO, _ZERO, _ZERO)
_ROOT = np.int32(0)
_SEED, _LONG_SEED = np.uint32(0x9E3779B9), np.uint32(0x3C6EF372)
_FINER = np.float32(1 / REFINEMENT)
_LAMP, _DIRECTION, _KINDS = np.uint32(0), np.uint32(1), np.uint32(2)
_LEAST_REFLECTED = np.float32(0.2)  # least probability of reflection by glass
_LONGEST = 6  # greatest number of interfaces
_FOURTH = np.float32(0.25)


class Photon(NamedTuple):
    """A photon where it arrives at a surface that is no caster, if `found`."""

    found: Any
    hit: Any  # the Hit there
    place: Any
    caster: Any
    kind: Any  # REFLECTED, TRANSMITTED or THROUGH
    flux: Any
    all: Any  # flux before the division between reflection and transmission
    lamp: Any  # the LampPoint where it started
    ray: Any  # RayDerivatives of its last ray, by its direction at the lamp, or by its place if that is distant
    pdf: Any  # of that direction or place, of the caster and of the kind, for this LampPoint


@device
def emission_pdf(scene, lamp, caster):
    """Returns the pdf of a photon's direction from a LampPoint to a caster; of its place, by area, if the lamp is distant."""
    x, y, z, radius = row(scene.caustics.bound, caster, 4)
    if lamp.kind == DISTANT:
        return _ONE / (_PI * radius * radius)
    way = vec.sub((x, y, z), lamp.target)
    square = vec.dot(way, way)
    if square <= radius * radius:
        return _ONE / _4PI
    sine2 = radius * radius / square
    return square_to_cone_pdf(sine2 / (_ONE + np.sqrt(_ONE - sine2)))


@device
def kind_chance(scene, caster, kind, cosine, eta):
    """Returns the probability with which a photon takes a kind of chain, by its first interface: cosine, eta there."""
    if scene.caustics.caster[caster, 3] == 0:
        return _ONE
    reflectance, _ = fresnel_dielectric(cosine, eta)
    reflects = max(reflectance, _LEAST_REFLECTED)
    return reflects if kind == REFLECTED else _ONE - reflects


@device
def _emit(scene, lamp, caster, u):
    """Returns (origin, unit direction, weight) of a photon from a LampPoint to a caster's bounding sphere.

    The photons of distant lamps start from beyond the scene. The weight is the flux of one photon if all start so.
    """
    x, y, z, radius = row(scene.caustics.bound, caster, 4)
    center = x, y, z
    if lamp.kind == DISTANT:
        low, high = row(scene.bounds, 0, 3), row(scene.bounds, 1, 3)
        reach = _TWO * vec.length(vec.sub(high, low))
        s, t = vec.basis(lamp.target)
        p = square_to_disk(u)
        offset = vec.add(vec.scale(s, radius * p[0]), vec.scale(t, radius * p[1]))
        start = vec.add(vec.add(center, offset), vec.scale(lamp.target, reach))
        return start, vec.neg(lamp.target), radius * radius / (square_to_disk_pdf(p) * lamp.pdf)
    way = vec.sub(center, lamp.target)
    square = vec.dot(way, way)
    if square <= radius * radius:
        d, weight = square_to_sphere(u), _4PI / lamp.pdf
    else:
        sine2 = radius * radius / square
        extent = sine2 / (_ONE + np.sqrt(_ONE - sine2))
        axis = vec.normalize(way)
        s, t = vec.basis(axis)
        d, weight = vec.to_world(s, t, axis, square_to_cone(u, extent)), _ONE / (square_to_cone_pdf(extent) * lamp.pdf)
    start = lamp.target
    if lamp.kind == AREA:
        weight *= abs(vec.dot(lamp.normal, d))
        start = leave(lamp.target, lamp.error, lamp.normal, d)
    return start, d, weight


@subroutine
def follow_photon(scene, stack, u, v):
    """Follows a photon; returns a Photon. u, v: four random numbers in [0, 1) each; the last one of v is not used."""
    never_inline()
    lamp = sample_lamp(scene, u[2], (u[0], u[1]))
    casters = len(scene.caustics.caster)
    caster = min(np.int32(u[3] * np.float32(casters)), np.int32(casters - 1))
    start, d, weight = _emit(scene, lamp, caster, (v[0], v[1]))
    light = lamp_light(scene, lamp, vec.add(start, d), vec.neg(d))
    flux = vec.maximum(light) * weight * np.float32(casters)
    whole, reflected = flux, scene.caustics.caster[caster, 3] == 0
    ray = leave_plane(d) if lamp.kind == DISTANT else leave_point(d)
    hit = closest_hit(scene.bvh, stack, start, d, _INF, None, _ROOT)
    place, kind, pdf = start, REFLECTED, _ZERO
    found = flux > _ZERO and caster_of(scene, hit) == caster
    if found:
        material = material_number(scene, hit.primitive)
        at = caster_point(scene, start, d, hit)
        p_u, p_v = arrive(ray, hit.t, at.geometric)
        eta = index_of(scene, material, at.front)
        cosine = -vec.dot(d, at.normal)
        if not reflected:
            reflectance, _ = fresnel_dielectric(cosine, eta)
            chance = max(reflectance, _LEAST_REFLECTED)
            reflected = v[2] < chance
            flux *= reflectance / chance if reflected else (_ONE - reflectance) / (_ONE - chance)
        kind = REFLECTED if reflected else TRANSMITTED
        pdf = emission_pdf(scene, lamp, caster) * kind_chance(scene, caster, kind, cosine, eta) / np.float32(casters)
        found, ray = redirect(ray, p_u, p_v, at, eta, reflected)
        place = leave(at.point, at.error, at.geometric, ray.d)
        hit = closest_hit(scene.bvh, stack, place, ray.d, _INF, None, _ROOT)
        entered = not reflected and at.front and scene.caustics.caster[caster, 2] != 0
        if found and entered and caster_of(scene, hit) == caster:
            at = caster_point(scene, place, ray.d, hit)
            p_u, p_v = arrive(ray, hit.t, at.geometric)
            found, ray = redirect(ray, p_u, p_v, at, index_of(scene, material, at.front), False)
            found = found and not at.front
            kind = THROUGH
            place = leave(at.point, at.error, at.geometric, ray.d)
            hit = closest_hit(scene.bvh, stack, place, ray.d, _INF, None, _ROOT)
        found = found and hit.primitive != NO_PRIMITIVE and caster_of(scene, hit) < 0
    return Photon(found, hit, vec.add(place, vec.scale(ray.d, hit.t)), caster, kind, flux, whole, lamp, ray, pdf)


@subroutine
def _record(scene, stack, count, photons):
    never_inline()
    found = 0
    for k in range(count):
        stream = Stream(INDEPENDENT, _SEED, pixel_key(0, 0), np.uint32(k))
        photon = follow_photon(scene, stack, draw4(stream, _LAMP), draw4(stream, _DIRECTION))
        if photon.found:
            left = vec.sub(photon.place, vec.scale(photon.ray.d, photon.hit.t))
            for axis in range(3):
                photons[found, PLACE + axis], photons[found, INTERFACE + axis] = photon.place[axis], left[axis]
            photons[found, CASTER], photons[found, REFLECTS] = photon.caster, photon.kind == REFLECTED
            photons[found, FLUX], photons[found, ALL] = photon.flux, photon.all
            found += 1
    return found


@subroutine
def _record_long(scene, stack, count, photons):
    """Follows photons through chains of interfaces; glass reflects each with a probability of 1/4 to 3/4.

    count, photons: as for `follow_long_photons`.
    """
    never_inline()
    found = 0
    casters = len(scene.caustics.caster)
    for k in range(count):
        stream = Stream(INDEPENDENT, _LONG_SEED, pixel_key(0, 0), np.uint32(k))
        u, v = draw4(stream, _LAMP), draw4(stream, _DIRECTION)
        lamp = sample_lamp(scene, u[2], (u[0], u[1]))
        aimed = min(np.int32(u[3] * np.float32(casters)), np.int32(casters - 1))
        start, d, weight = _emit(scene, lamp, aimed, (v[0], v[1]))
        light = lamp_light(scene, lamp, vec.add(start, d), vec.neg(d))
        flux = vec.maximum(light) * weight * np.float32(casters)
        kind, crosses, caster, last = np.int32(0), False, np.int32(-1), start
        choices = v[2], v[3], v[2], v[2]
        for number in range(_LONGEST + 1):
            hit = closest_hit(scene.bvh, stack, start, d, _INF, None, _ROOT)
            own = caster_of(scene, hit)
            if own < 0 or number == _LONGEST or not flux > _ZERO or (number == 0 and own != aimed):
                break
            caster = own
            material = material_number(scene, hit.primitive)
            at = caster_point(scene, start, d, hit)
            eta = index_of(scene, material, at.front)
            cosine = -vec.dot(d, at.normal)
            reflects = scene.caustics.caster[caster, 3] == 0
            if number == 2:
                choices = draw4(stream, _KINDS)
            if not reflects:
                choice = choices[number - 2 if number >= 2 else number]
                reflectance, _ = fresnel_dielectric(cosine, eta)
                chance = _ONE if reflectance >= _ONE else min(max(reflectance, _FOURTH), _ONE - _FOURTH)
                reflects = choice < chance
                flux /= chance if reflects else _ONE - chance
            flux *= vec.maximum(interface_weight(scene, material, cosine, eta, reflects)) * (_ONE if reflects else eta * eta)
            exists, ray = redirect(leave_point(d), _BLACK, _BLACK, at, eta, reflects)
            if not (exists and at.regular):
                flux = _ZERO
            # Seen from the other end, the last interface comes first.
            kind = np.int32(kind + ((1 if reflects else 0) << number))
            last, d = at.point, ray.d
            start = leave(at.point, at.error, at.geometric, d)
            if number == 0:
                crosses = not reflects and at.front and scene.caustics.caster[caster, 2] != 0
            elif number == 1:
                crosses = crosses and not reflects and not at.front and own == aimed
        if number >= 2 and flux > _ZERO and own < 0 and hit.primitive != NO_PRIMITIVE and not (crosses and number == 2):
            place = vec.add(start, vec.scale(d, hit.t))
            for axis in range(3):
                photons[found, PLACE + axis], photons[found, INTERFACE + axis] = place[axis], last[axis]
            photons[found, CASTER], photons[found, FLUX] = caster, flux
            photons[found, KIND] = np.int32(kind + (1 << number)) + LONG
            found += 1
    return found


@entry
def follow_long_photons(scene, stack, count, photons):
    """Follows `count` photons through long chains and records those that arrive, (count, LONG_COLUMNS) f32; returns their number.

    scene: has `caustics`. Their weights differ, so that all kinds are found.
    """
    return _record_long(by_reference(scene), stack, count, photons)


@entry
def follow_caustic_photons(scene, stack, count, photons):
    """Follows `count` photons and records those that arrive, (count, PHOTON_COLUMNS) f32; returns their number.

    scene: has `caustics`, without brightness.
    """
    return _record(by_reference(scene), stack, count, photons)


@entry
def photon_buckets(photons, scale, buckets):
    """Writes the buckets of photons, (LEVELS, n) i32. scale: cubes per unit length of the finest level."""
    for level in range(LEVELS):
        for k in range(len(photons)):
            p = photons[k, PLACE], photons[k, PLACE + 1], photons[k, PLACE + 2]
            buckets[level, k] = bucket_of(p, np.int32(photons[k, CASTER]), level, scale)
        scale = scale * _FINER
