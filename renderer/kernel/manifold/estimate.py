"""The estimator of specular manifold sampling: one solution's light, divided by the probability of finding it.

That probability is not known; its reciprocal is estimated by the number of further walks until one finds the same solution again
(Zeltner et al. 2020, 4.1), which is unbiased. The number is limited to `Options.caustic_trials`, N: a solution that is found
with probability p loses the fraction (1 - p)**N of its light. At the limit of 4,096, less than 1e-17 is lost for p = 0.01.

A walk looks for all short chains of a caster at once, or for one long kind, which is chosen before it starts.

Vertices whose throughput is small, and those where photons have found little light (brightness.py), are sampled with a
probability below 1 and weighted by its reciprocal.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from renderer.bvh.traverse import SHADOW_REACH, any_hit, closest_hit
from renderer.jit import device, never_inline, subroutine
from renderer.kernel import vec
from renderer.kernel.light.lights import FAR
from renderer.kernel.manifold.brightness import choose_chain, sampling_rates, seed_bucket
from renderer.kernel.manifold.caster import caster_of
from renderer.kernel.manifold.differentials import perpendicular_area, solid_angle_area
from renderer.kernel.manifold.lamps import AREA, DISTANT, lamp_light, sample_lamp
from renderer.kernel.manifold.meeting import bounce_density, photon_chance, photon_density, share
from renderer.kernel.manifold.seeds import seed_direction
from renderer.kernel.manifold.walk import (
    LAST_STEP2,
    LONG,
    REFLECTED,
    interface_count,
    last_out,
    reflects_at,
    walk_to_lamp,
)
from renderer.kernel.material.material import eval_material
from renderer.kernel.steps.depths import count_bounce, reached_limit
from renderer.kernel.steps.random_blocks import draw_caustic, draw_trial
from renderer.kernel.surface.ray_origins import leave, offset_ray_origin

__all__ = ["SAME2", "CausticLight", "estimate_caustic", "importance_of", "solution_light"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_INF = np.float32(np.inf)
_BLACK = (_ZERO, _ZERO, _ZERO)
_ROOT = np.int32(0)
_YES, _NO = np.bool_(True), np.bool_(False)
_INDIRECT = np.float32(0.12)  # importance of a vertex that the camera does not see, at throughput 1
_LEAST_DENSITY = np.float32(1e-12)
SAME2 = np.float32(1e-6)  # squared distance up to which two unit directions are the same solution: walks end within some 3e-4


class CausticLight(NamedTuple):
    """Light that reaches a vertex through a caster, with the path's number of segments and the number of traced rays."""

    radiance: Any  # scattered towards the viewer, per unit of throughput
    segments: Any  # number of the path's segments with it, a float
    rays: Any  # number of rays traced


@device
def _is_within_depth(kind, path, counts, scatters_up, scatter_pdf, options):
    """Returns (whether a path sampled by the BSDF could take this chain within the depth limits, number of its segments)."""
    depth = path.depth + _ONE
    counts = count_bounce(counts, _YES, scatters_up, scatter_pdf)
    is_free = options.transmission_depth > 0
    within = _YES
    following = interface_count(kind)
    while following > 0:
        following -= 1
        reflects = reflects_at(kind, following)
        within = within and depth + _ONE < np.float32(options.max_depth)
        if options.has_depths:
            within = within and not reached_limit(counts, options)
        if reflects or not is_free:
            depth += _ONE
        counts = count_bounce(counts, _YES, reflects, _ZERO)
    return within, depth + _ONE


@device
def solution_light(scene, stack, vertex, path, counts, lamp, caster, walk, options):
    """Returns (light of a solution, rgb, per unit of throughput; segments of the path with it; `photon_density`; rays traced)."""
    s, t, n = vertex.frame
    wi = vec.to_local(s, t, n, walk.d)
    f, scatter_pdf = eval_material(vertex.material, vertex.wo, wi)
    within, segments = _is_within_depth(walk.kind, path, counts, wi[2] > _ZERO, scatter_pdf, options)
    if not (within and walk.regular and vec.maximum(f) > _ZERO):
        return _BLACK, segments, _ZERO, 0
    exists, out, weight = last_out(scene, walk, walk.material)
    at = walk.at
    start = leave(at.point, at.error, at.geometric, out.d)
    if lamp.kind == DISTANT:
        towards, spread = lamp.target, solid_angle_area(out)
        density = spread
        end = vec.add(start, vec.scale(towards, FAR))
    else:
        way = vec.sub(lamp.target, at.point)
        distance = vec.length(way)
        towards, spread = vec.scale(way, _ONE / distance), perpendicular_area(out, distance)
        density = spread
        end = lamp.target
        if lamp.kind == AREA:
            density /= max(abs(vec.dot(lamp.normal, towards)), np.float32(1e-6))
            end = leave(lamp.target, lamp.error, lamp.normal, vec.neg(towards))
    light = lamp_light(scene, lamp, at.point, towards)
    brought = vec.scale(vec.mul(vec.mul(f, weight), light), _ONE / (density * lamp.pdf))
    if not (exists and density > _ZERO and vec.maximum(brought) > _ZERO):
        return _BLACK, segments, _ZERO, 0
    if any_hit(scene.bvh, stack, start, vec.sub(end, start), SHADOW_REACH, None, _ROOT):
        return _BLACK, segments, _ZERO, 1
    return brought, segments, photon_density(scene, lamp, caster, walk, spread, vertex.surface), 1


@device
def importance_of(path, roulette_weight):
    """Returns the importance of a vertex: 1 if the camera sees it, also through glass, else less, by the path's throughput."""
    if path.number == _ZERO:
        return _ONE
    return _INDIRECT * min(vec.maximum(path.throughput) * roulette_weight, _ONE)


@subroutine
def estimate_caustic(scene, stack, vertex, path, roulette_weight, counts, last, is_rivaled, options, stream):
    """Samples the light of small lamps that reaches a vertex through casters; returns a CausticLight.

    roulette_weight: of the path's ray. last: the LastVertex. is_rivaled: whether photons also bring this light to the last vertex
    (meeting.py), so that the light is weighted. counts: the path's depth counts. Traces rays with `stack`. The scene must have
    `caustics`.
    """
    never_inline()
    u = draw_caustic(stream, path.number)
    surface, n = vertex.surface, vertex.frame[2]
    importance = importance_of(path, roulette_weight)
    paths = bounce_density(last, surface) if is_rivaled else _ONE
    chance_of_photon = photon_chance(path.number - _ONE)  # at the last vertex
    rivals = chance_of_photon / max(paths, _LEAST_DENSITY) if is_rivaled else _ZERO
    chosen = choose_chain(scene, surface.point, vertex.normal, importance, rivals, u[3])
    caster, chance, is_long = chosen.caster, chosen.chance, chosen.kind >= LONG
    if caster < 0:
        return CausticLight(_BLACK, _ZERO, 0)
    lamp = sample_lamp(scene, u[2], (u[0], u[1]))
    is_distant = lamp.kind == DISTANT
    rates, rays = (_ONE, _ONE), 0
    if is_long:
        line = vec.normalize(vec.sub(chosen.seed, surface.point)) if chosen.is_seeded else vertex.frame[2]
        is_aimed, bucket = chosen.is_seeded, -1
    else:
        bucket = seed_bucket(scene, surface.point, caster)
        transmitted, reflected = sampling_rates(scene, surface.point, caster, importance, rivals)
        greater = max(transmitted, reflected)  # has been counted in the choice of the caster
        rates = transmitted / greater, reflected / greater
        line = lamp.target if is_distant else vec.normalize(vec.sub(lamp.target, surface.point))
        start = offset_ray_origin(surface, vec.dot(n, line) > _ZERO, line)
        is_aimed = caster_of(scene, closest_hit(scene.bvh, stack, start, line, _INF, None, _ROOT)) == caster
        rays = 1
    trials, brought, segments = 0, _BLACK, _ZERO
    limit, kind = line, chosen.kind  # of the first walk
    for trial in range(options.caustic_trials + 1):
        u = draw_trial(stream, path.number, trial)
        towards = seed_direction(scene, caster, surface.point, line, is_aimed, bucket, (u[0], u[1], u[2]))
        walk = walk_to_lamp(scene, stack, surface, n, towards, caster, lamp.target, is_distant, kind, rates, LAST_STEP2, u[3])
        rays += walk.rays
        if trial == 0:
            if not walk.found:
                break
            limit, kind = walk.limit, walk.kind
            known = vertex, path, counts, lamp, caster, walk, options
            brought, segments, photons, shadow_rays = solution_light(scene, stack, *known)
            rays += shadow_rays
            if is_rivaled and not is_long:
                brought = vec.scale(brought, share(paths, photons * chance_of_photon))
            if not is_long:
                chance *= rates[1] if kind == REFLECTED else rates[0]
            if not vec.maximum(brought) > _ZERO:
                break
        else:
            trials = trial
            off = vec.sub(walk.limit, limit)
            if walk.found and vec.dot(off, off) < SAME2:
                break
    return CausticLight(vec.scale(brought, np.float32(trials) / chance), segments, rays)
