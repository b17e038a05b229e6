"""Ambient occlusion: the share of a white environment that each surface sees, without materials and lights.

Zhukov et al., 1998.
"""

from __future__ import annotations

import numpy as np

from renderer.bvh.traverse import FROM_ORIGIN, NO_PRIMITIVE, camera_root, closest_hit
from renderer.jit import local_floats, template
from renderer.kernel import vec
from renderer.kernel.integrators.depths import is_blocked, layers_left
from renderer.kernel.integrators.record import DIRECT, record_light, record_miss, record_surface
from renderer.kernel.integrators.state import camera_path, passed_through, with_throughput
from renderer.kernel.integrators.transport import forget_first_hit, keep_first_hit, reach
from renderer.kernel.integrators.visibility import transmittance
from renderer.kernel.material.material import LAYER_SLOTS, fetch_material
from renderer.kernel.material.normal_map import shading_frame
from renderer.kernel.sampling.sampler import draw4
from renderer.kernel.sampling.warp import square_to_cosine_hemisphere
from renderer.kernel.surface.ray_origins import departure
from renderer.kernel.surface.surface import surface_at
from renderer.prune_absent_features import where_present

__all__ = ["trace_ao"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_INF = np.float32(np.inf)
_FAR = np.float32(1e18)
_WHITE = (_ONE, _ONE, _ONE)
_BLACK = (_ZERO, _ZERO, _ZERO)


@template
def trace_ao(scene, stack, o, d, time, nest, options, stream, log, first):
    """Traces one ambient occlusion sample, see `trace_path`: 1 where no surface is within options.ao_distance.

    The direction is cosine-weighted. Camera rays that miss return 1. The expectation is 1 for a convex body, and 1 - D^2 / 4
    inside the unit sphere at distance D up to 2.
    """
    forget_first_hit(first)
    path = camera_path(o, d, None)
    radiance = _WHITE
    rays = passed = 0
    layers = local_floats(LAYER_SLOTS)
    after = where_present(scene.has.textures, FROM_ORIGIN)
    while True:
        hit = closest_hit(scene.bvh, stack, path.o, path.d, _INF, time, camera_root(scene.bvh), after)
        rays += 1
        if hit.primitive == NO_PRIMITIVE:
            if passed < len(log):
                record_miss(log, passed, path)
                record_light(log, passed, DIRECT, radiance)
            break
        surface = surface_at(scene, path.o, path.d, hit)
        through, throughput = reach(scene, surface, path, options, stream, passed, time)
        if passed < len(log):
            record_surface(log, passed, surface, through, hit.t, with_throughput(path, throughput))
        if through:
            if is_blocked(scene, surface.material, path.counts, options):
                radiance = _BLACK
                break
            path = passed_through(scene, surface, path)
            if scene.has.textures is not None:
                after = hit.t, hit.instance, hit.primitive
            passed += 1
            continue
        s, t, n = shading_frame(scene, surface, vec.neg(path.d), time)
        albedo = fetch_material(scene, surface, (s, t, n), layers, time).base
        keep_first_hit(first, surface, albedo, n, hit.t)
        numbers = draw4(stream, np.uint32(1))
        towards = vec.to_world(s, t, n, square_to_cosine_hemisphere((numbers[0], numbers[1])))
        start = departure(surface, True, towards)
        end = vec.add(start, vec.scale(towards, min(options.ao_distance, _FAR)))
        rays += 1
        open_sky = transmittance(scene, stack, start, end, options.transparent, layers_left(path.counts, options), time)
        radiance = (open_sky, open_sky, open_sky)
        if passed < len(log):
            record_light(log, passed, DIRECT, radiance)
        break
    return radiance, rays
