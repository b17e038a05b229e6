"""Light that a photon, sent through a caster, brings to a path's vertex by way of the matt surface where it arrives."""

from __future__ import annotations

import numpy as np

from renderer.bvh.traverse import closest_hit
from renderer.jit import never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.backends.scalar.vertex import surface_vertex
from renderer.kernel.manifold.differentials import arrive, perpendicular_area
from renderer.kernel.manifold.estimate import SAME2, CausticLight, solution_light
from renderer.kernel.manifold.lamps import DISTANT
from renderer.kernel.manifold.meeting import bounce_density, is_met, photon_chance, share
from renderer.kernel.manifold.photons import follow_photon
from renderer.kernel.manifold.walk import REFLECTED, walk_to_lamp
from renderer.kernel.material.material import eval_material
from renderer.kernel.steps.continue_or_end import is_last
from renderer.kernel.steps.depths import count_bounce
from renderer.kernel.steps.random_blocks import draw_photon
from renderer.kernel.steps.scatter import is_counted
from renderer.kernel.steps.state import LastVertex, PathState, Ray
from renderer.kernel.surface.ray_origins import leaves, offset_ray_origin
from renderer.kernel.surface.surface import owner_at, surface_at
from renderer.wide.values import u32

__all__ = ["meet_photon"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_INF = np.float32(np.inf)
_BLACK = (_ZERO, _ZERO, _ZERO)
_ROOT = np.int32(0)
_NO = np.bool_(False)
_NEAR = np.float32(1e-3)  # greatest distance between the photon's place and the end of the ray to it, over the ray's length
_LEAST_SURVIVAL = np.float32(0.1)
_LEAST = np.float32(1e-20)
_1_PI = np.float32(1 / np.pi)
_RAREST = np.float32(1.0 - 2.0**-20)


@subroutine
def meet_photon(scene, stack, vertex, ray, path, counts, options, stream, layers, time, wavelengths):
    """Samples the light of small lamps that reaches a vertex through one caster and by one matt surface; returns a CausticLight.

    ray: the path's ray to the vertex. counts: the path's depth counts. layers: as for `surface_vertex`, other than the vertex's
    own. Traces rays with `stack`.
    """
    never_inline()
    u, v = draw_photon(stream, path.number)
    most = photon_chance(path.number)
    chance = most if path.number == _ZERO else most * min(vec.maximum(path.throughput) * ray.roulette_weight, _ONE)
    if v[3] >= chance:
        return CausticLight(_BLACK, _ZERO, 0)
    photon = follow_photon(scene, stack, u, v)
    rays = 2 if photon.kind == REFLECTED else 3
    if not photon.found or not is_met(scene, owner_at(scene, photon.hit)[1], options):
        return CausticLight(_BLACK, _ZERO, rays)

    s, t, n = vertex.frame
    way = vec.sub(photon.place, vertex.surface.point)
    length = vec.length(way)
    d = vec.scale(way, _ONE / length)
    wi = vec.to_local(s, t, n, d)
    f, scatter_pdf = eval_material(vertex.material, vertex.wo, wi)
    if not vec.maximum(f) > _ZERO:
        return CausticLight(_BLACK, _ZERO, rays)
    # Photons whose weight will be small are not worth the rays that are still to be traced.
    arriving = photon.pdf * most / max(perpendicular_area(photon.ray, photon.hit.t), _LEAST)
    likely = share(arriving, abs(vec.dot(n, d)) * _1_PI / (length * length))
    survival = min(_LEAST_SURVIVAL + _TWO * likely, _ONE)
    if v[3] >= chance * survival:  # v[3] < chance so far
        return CausticLight(_BLACK, _ZERO, rays)
    chance *= survival
    reflected = wi[2] > _ZERO
    has_left = leaves(vertex.surface, reflected, d)
    depth = path.depth + _ONE if is_counted(has_left, reflected, scatter_pdf, options) else path.depth
    beyond = PathState(_BLACK, depth, path.throughput, path.number + _ONE)
    counts = count_bounce(counts, has_left, reflected, scatter_pdf)
    if is_last(beyond, counts, _NO, options):
        return CausticLight(_BLACK, _ZERO, rays)

    start = offset_ray_origin(vertex.surface, reflected, d)
    hit = closest_hit(scene.bvh, stack, start, d, _INF, None, _ROOT)
    rays += 1
    is_same = hit.primitive == photon.hit.primitive and hit.instance == photon.hit.instance
    if not (is_same and abs(hit.t - length) < _NEAR * length):
        return CausticLight(_BLACK, _ZERO, rays)
    surface = surface_at(scene, start, d, hit)
    met, _ = surface_vertex(scene, surface, Ray(start, d, scatter_pdf, _ONE), beyond, stream, layers, time, wavelengths)

    towards = vec.neg(photon.ray.d)
    rates = _ONE, _ONE
    choice = _RAREST if photon.kind == REFLECTED else _ZERO  # of the kinds that a walk looks for where both may be
    lamp, normal = photon.lamp, met.frame[2]
    known = photon.caster, lamp.target, lamp.kind == DISTANT, photon.kind, rates, _INF, choice
    walk = walk_to_lamp(scene, stack, surface, normal, towards, *known)
    rays += walk.rays
    off = vec.sub(walk.d, towards)
    if not (walk.found and vec.dot(off, off) < SAME2):
        return CausticLight(_BLACK, _ZERO, rays)
    brought, segments, photons, shadow_rays = solution_light(
        scene, stack, met, beyond, counts, lamp, photon.caster, walk, options
    )
    rays += shadow_rays
    if not vec.maximum(brought) > _ZERO:
        return CausticLight(_BLACK, _ZERO, rays)
    last = LastVertex(vertex.surface.point, vertex.normal, u32(vertex.surface.object))
    p_u, p_v = arrive(photon.ray, photon.hit.t, surface.geometric)
    area = vec.length(vec.cross(p_u, p_v))  # that photons cover, per unit of `photon.pdf`
    cosine = abs(vec.dot(surface.geometric, d))
    weight = share(photons * most, bounce_density(last, surface)) * area / (photon.pdf * chance)
    weight *= cosine / (length * length)
    return CausticLight(vec.scale(vec.mul(f, brought), weight), segments, rays)
