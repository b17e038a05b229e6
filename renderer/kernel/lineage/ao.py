"""Ambient occlusion: the fraction of a white environment that each surface sees, without materials and lights.

Zhukov et al., 1998.
"""

from __future__ import annotations

import numpy as np

from renderer.bvh.traverse import FROM_ORIGIN, NO_PRIMITIVE, camera_root, closest_hit, shadow_root
from renderer.jit import local_floats, template
from renderer.kernel import vec
from renderer.kernel.backends.scalar.first_hit import store_first_hit
from renderer.kernel.backends.scalar.vertex import LAYER_SLOTS, reach_surface, surface_vertex
from renderer.kernel.backends.scalar.visibility import transmittance
from renderer.kernel.path_trace import DIRECT, record_light, record_miss, record_surface
from renderer.kernel.sampling.warp import square_to_cosine_hemisphere
from renderer.kernel.steps.depths import layers_left
from renderer.kernel.steps.pass_through import pass_through
from renderer.kernel.steps.random_blocks import draw_light
from renderer.kernel.steps.record_first_hit import record_first_hit
from renderer.kernel.steps.state import LastVertex, camera_path, no_crossings
from renderer.kernel.surface.ray_origins import offset_ray_origin
from renderer.kernel.surface.surface import NO_OBJECT, surface_at
from renderer.prune_absent_features import where_present

__all__ = ["trace_ao"]

_ZERO = np.float32(0.0)
_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_INF = np.float32(np.inf)
_FAR = np.float32(1e18)
_WHITE = (_ONE, _ONE, _ONE)
_BLACK = (_ZERO, _ZERO, _ZERO)


@template
def trace_ao(scene, stack, camera, medium_stack, options, log, first):
    """Traces one ambient occlusion sample: returns 1 if no surface is within options.ao_distance of the first hit, else 0.

    Parameters and result are those of `trace_path`. The direction is cosine-weighted. Camera rays that miss return 1. The
    expectation is 1 for a convex body, and 1 - D^2 / 4 inside the unit sphere at an ao_distance D of up to 2.
    """
    ray, path = camera_path(camera.o, camera.d)
    last, crossings, time = LastVertex(camera.o, _BLACK, NO_OBJECT), no_crossings(medium_stack, camera.start), camera.time
    radiance, rays, passed = _WHITE, 0, _ZERO
    layers = local_floats(LAYER_SLOTS)
    after = where_present(scene.has.textures, FROM_ORIGIN)
    while True:
        hit = closest_hit(scene.bvh, stack, ray.o, ray.d, _INF, time, camera_root(scene.bvh), after)
        rays += 1
        if hit.primitive == NO_PRIMITIVE:
            record_miss(log, passed, ray, path)
            record_light(log, passed, DIRECT, radiance)
            break
        surface = surface_at(scene, ray.o, ray.d, hit)
        through, arrived = reach_surface(scene, surface, path, last, passed, camera.stream, options, time)
        record_surface(log, passed, surface, surface.point, through, hit.t, ray, arrived)
        if through:
            crossings, blocked = pass_through(scene, surface, through, crossings, options)
            if blocked:
                radiance = _BLACK
                break
            after = where_present(scene.has.textures, (hit.t, hit.instance, hit.primitive))
            passed += _ONE
            continue
        vertex, _ = surface_vertex(scene, surface, ray, path, camera.stream, layers, time)
        s, t, n = vertex.frame
        store_first_hit(first, record_first_hit(surface, vertex.material, n, hit.t, camera.start))
        numbers = draw_light(camera.stream, _ZERO)
        towards = vec.to_world(s, t, n, square_to_cosine_hemisphere((numbers[0], numbers[1])))
        start = offset_ray_origin(surface, True, towards)
        end = vec.add(start, vec.scale(towards, min(options.ao_distance, _FAR)))
        rays += 1
        left = layers_left(crossings.counts, options)
        open_sky = transmittance(scene, stack, start, end, options.transparent, left, time, shadow_root(scene.bvh))
        radiance = (open_sky, open_sky, open_sky)
        record_light(log, passed, DIRECT, radiance)
        break
    return radiance, rays
