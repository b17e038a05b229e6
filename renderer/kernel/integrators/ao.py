"""Ambient occlusion: how much of a white world each surface sees, materials and lights left aside (Zhukov et al., 1998)."""

from __future__ import annotations

import numpy as np

from renderer.bvh.traverse import NO_PRIMITIVE, closest_hit
from renderer.jit import local_floats, template
from renderer.kernel import vec
from renderer.kernel.integrators.record import DIRECT, MISSED, record_light, record_vertex
from renderer.kernel.integrators.transport import forget_first_hit, keep_first_hit, reach
from renderer.kernel.integrators.visibility import MAX_PASSED, transmittance
from renderer.kernel.material.material import LAYER_SLOTS, fetch_material
from renderer.kernel.sampling.sampler import uniform4
from renderer.kernel.sampling.warp import square_to_cosine_hemisphere
from renderer.kernel.surface.normal_map import shading_frame
from renderer.kernel.surface.surface import departure, surface_at

__all__ = ["trace_ao"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_INF = np.float32(np.inf)
_FAR = np.float32(1e18)
_BLACK = (_ZERO, _ZERO, _ZERO)
_WHITE = (_ONE, _ONE, _ONE)


@template
def trace_ao(scene, stack, o, d, options, pixel, sample, log, first, special):
    """As `trace_path` of path.py: 1 where nothing is within options.ao_distance in a cosine-weighted direction.

    What the camera sees of the world itself is white. An expectation of 1 for a convex body, of 1 - D^2 / 4 within the unit
    sphere at distance D up to 2.
    """
    radiance = _WHITE
    forget_first_hit(first)
    depth = _ZERO
    rays = 0
    layers = local_floats(LAYER_SLOTS)
    for passed in range(MAX_PASSED):
        hit = closest_hit(scene.bvh, stack, o, d, _INF)
        rays += 1
        if hit.primitive == NO_PRIMITIVE:
            if passed < len(log):
                record_vertex(log, passed, MISSED, 0, 0, hit.t, _ZERO, o, d, d, _WHITE, _BLACK)
                record_light(log, passed, DIRECT, radiance)
            break
        surface = surface_at(scene, o, d, hit)
        depth += hit.t
        through, _ = reach(scene, surface, hit.t, d, o, options, pixel, sample, passed, _ZERO, _WHITE, _BLACK, log)
        if through:
            o = departure(surface, False, d)
            continue
        s, q, n = shading_frame(scene, surface, vec.neg(d))
        albedo = fetch_material(scene, surface, (s, q, n), layers).base
        keep_first_hit(first, surface, albedo, n, depth)
        r = uniform4(options.sampler, options.seed, pixel, sample, np.uint32(1))
        towards = vec.to_world(s, q, n, square_to_cosine_hemisphere((r[0], r[1])))
        start = departure(surface, True, towards)
        end = vec.add(start, vec.scale(towards, min(options.ao_distance, _FAR)))
        rays += 1
        open_sky = transmittance(scene, stack, start, end, options.transparent)
        radiance = (open_sky, open_sky, open_sky)
        if passed < len(log):
            record_light(log, passed, DIRECT, radiance)
        break
    return radiance, rays
