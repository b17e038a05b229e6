"""Ray tracing after Whitted, "An Improved Illumination Model for Shaded Display" (1980), for comparison with path tracing.

Only mirrors and glass are followed: diffuse and glossy surfaces receive direct light, and a constant instead of indirect light.
Where Whitted splits a ray at glass, the sampler chooses one direction.

With one light sample per vertex a light is sampled at its centre: shadows are sharp, and only the choice among lights is random.
With more light samples, as many random points are sampled, for soft shadows. The environment has no centre.
"""

from __future__ import annotations

import numpy as np

from renderer.arrays.light_rows import CORNER_ERROR
from renderer.arrays.rows import CONDUCTOR, METALLIC_ROUGHNESS, UNLIT
from renderer.bvh.traverse import FROM_ORIGIN, NO_PRIMITIVE, camera_root, closest_hit, shadow_root
from renderer.jit import device, local_floats, template
from renderer.kernel import vec
from renderer.kernel.backends.scalar.first_hit import store_first_hit
from renderer.kernel.backends.scalar.light import has_lights
from renderer.kernel.backends.scalar.vertex import LAYER_SLOTS, reach_surface, surface_vertex
from renderer.kernel.backends.scalar.visibility import transmittance
from renderer.kernel.light.environment import environment_radiance
from renderer.kernel.light.light_sample import LightSample
from renderer.kernel.light.lights import choose_light, sample_light, sample_one_light, sun_seen
from renderer.kernel.light.sphere_light import hits_emitting_side
from renderer.kernel.lineage.strategy import mistake_factor
from renderer.kernel.material.material import emission, eval_material, is_specular, sample_material
from renderer.kernel.options import NO_MISTAKE
from renderer.kernel.path_trace import DIRECT, EMITTED, record_light, record_miss, record_surface
from renderer.kernel.sampling.sampler import substream
from renderer.kernel.steps.continue_or_end import MAX_UNCOUNTED
from renderer.kernel.steps.depths import layers_left
from renderer.kernel.steps.pass_through import counts_emission, pass_through
from renderer.kernel.steps.random_blocks import draw_light, draw_scattering
from renderer.kernel.steps.record_first_hit import record_first_hit
from renderer.kernel.steps.scatter import cross_surface, scatter
from renderer.kernel.steps.state import BsdfSample, LastVertex, camera_path, no_crossings, with_radiance
from renderer.kernel.surface.ray_origins import offset_ray_origin
from renderer.kernel.surface.surface import NO_OBJECT, is_emissive, surface_at
from renderer.prune_absent_features import where_present
from renderer.wide.values import u32

__all__ = ["trace_whitted"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_HALF = np.float32(0.5)
_QUARTER = np.float32(0.25)
_INF = np.float32(np.inf)
_ROOT = np.int32(0)
_BLACK = (_ZERO, _ZERO, _ZERO)
_YES, _NO = np.bool_(True), np.bool_(False)
_MAX_AGAIN = np.float32(MAX_UNCOUNTED)
_POLISHED = np.float32(0.15)  # roughness up to which a metal is treated as a mirror


@device
def _is_polished(material):
    """Returns True if the material is a metal smooth enough for its reflections to be followed as at a mirror."""
    if material.kind == METALLIC_ROUGHNESS:
        return material.metallic > _HALF and material.roughness <= _POLISHED
    return material.kind == CONDUCTOR and material.roughness <= _POLISHED


@device
def _edge2(scene, i, j):
    d = (
        scene.position[i, 0] - scene.position[j, 0],
        scene.position[i, 1] - scene.position[j, 1],
        scene.position[i, 2] - scene.position[j, 2],
    )
    return vec.dot(d, d)


@device
def _middle(scene, light):
    """Returns the random numbers for which `sample_one_light` samples a light's centre.

    For a triangle that is the middle of its longest edge, as if it were half of a rectangle; for a sphere the point nearest to
    the lit point.
    """
    primitive = scene.light_primitive[light]
    if primitive >= len(scene.triangle):
        is_sphere = primitive < len(scene.triangle) + len(scene.sphere)
        return (_ZERO, _ZERO) if is_sphere else (_HALF, _HALF)
    if len(scene.light_parallelogram) > 0 and scene.light_parallelogram[light, CORNER_ERROR] > _ZERO:
        return _HALF, _HALF
    i, j, k = scene.triangle[primitive, 0], scene.triangle[primitive, 1], scene.triangle[primitive, 2]
    ab, bc, ca = _edge2(scene, i, j), _edge2(scene, j, k), _edge2(scene, k, i)
    # The inverse of square_to_triangle at the edges' middles
    if ab >= bc and ab >= ca:
        return _ONE, _HALF
    return (_QUARTER, _ONE) if bc >= ca else (_QUARTER, _ZERO)


@device
def _look_at_light(scene, p, normal, middle, choice, u, time):
    """Samples a light as `sample_light` does, but at the light's centre if `middle` is True."""
    chance = scene.environment_frame[3]
    if not middle or choice < chance or len(scene.light_primitive) == 0:
        return sample_light(scene, p, normal, choice, u, time)
    light, of_light = choose_light(scene, p, normal, (choice - chance) / (_ONE - chance) if chance > _ZERO else choice)
    sample = sample_one_light(scene, light, p, None, u if _is_within(scene, light, p) else _middle(scene, light), time)
    pdf = sample.pdf * (_ONE - chance) * of_light
    return LightSample(sample.direction, sample.end, sample.radiance, pdf, sample.alone)


@device
def _is_within(scene, light, p):
    number = scene.light_primitive[light] - len(scene.triangle)
    if number < 0 or number >= len(scene.sphere):
        return False
    d = (scene.sphere[number, 0] - p[0], scene.sphere[number, 1] - p[1], scene.sphere[number, 2] - p[2])
    return vec.dot(d, d) < scene.sphere[number, 3] * scene.sphere[number, 3]


@device
def _is_mirror(material):
    """Returns True if the ray continues with a reflection at this material, as at mirrors, and lights are not sampled."""
    return is_specular(material) or _is_polished(material)


@device
def _add(path, light):
    return with_radiance(path, vec.add(path.radiance, vec.mul(path.throughput, light)))


@template
def trace_whitted(scene, stack, camera, medium_stack, options, log, first):
    """Traces one sample by Whitted's algorithm; parameters and result are those of `trace_path`.

    options.max_depth counts the segments from the camera to the last surface. Scattering in media is ignored.
    """
    ray, path = camera_path(camera.o, camera.d)
    last, crossings = LastVertex(camera.o, _BLACK, NO_OBJECT), no_crossings(medium_stack, camera.start)
    passed, rays, time, stream = _ZERO, 0, camera.time, camera.stream
    lit = has_lights(scene)
    layers = local_floats(LAYER_SLOTS)
    after = where_present(scene.has.textures, FROM_ORIGIN)
    while True:
        root = camera_root(scene.bvh) if path.number == _ZERO else _ROOT
        hit = closest_hit(scene.bvh, stack, ray.o, ray.d, _INF, time, root, after)
        rays += 1
        row = path.number + passed
        if hit.primitive == NO_PRIMITIVE:
            record_miss(log, row, ray, path)
            path = _add(path, environment_radiance(scene.environment, scene.environment_frame, ray.d))
            if scene.has.lights is not None:
                for k in range(len(scene.sun)):
                    seen, _ = sun_seen(scene, k, last.point, last.normal, ray.d, _NO, path.number == _ZERO, time)
                    path = _add(path, seen)
            record_light(log, row, EMITTED, path.radiance)
            break

        surface = surface_at(scene, ray.o, ray.d, hit)
        through, path = reach_surface(scene, surface, path, last, row, stream, options, time)
        record_surface(log, row, surface, surface.point, through, hit.t, ray, path)
        if is_emissive(surface) and counts_emission(scene, surface, through):
            front = hits_emitting_side(scene, surface.light, last.point, ray.d, surface.front, time)
            path = _add(path, emission(scene, surface.material, surface.uv, surface.uv1, front, time))
        if through:
            record_light(log, row, EMITTED, path.radiance)
            crossings, blocked = pass_through(scene, surface, through, crossings, options)
            if blocked:
                break
            passed += _ONE
            after = where_present(scene.has.textures, (hit.t, hit.instance, hit.primitive))
            continue

        vertex, path = surface_vertex(scene, surface, ray, path, stream, layers, time)
        material = vertex.material
        if path.number == _ZERO:
            store_first_hit(first, record_first_hit(surface, material, vertex.frame[2], hit.t, camera.start))
        if material.kind == UNLIT:
            path = _add(path, material.base)
        elif not _is_mirror(material):
            path = _add(path, vec.mul(material.base, options.ambient))
        record_light(log, row, EMITTED, path.radiance)
        if path.depth + _ONE >= np.float32(options.max_depth) or material.kind == UNLIT:
            break

        if lit and not _is_mirror(material):
            path, shadow_rays = _add_direct(scene, stack, vertex, path, crossings, options, stream, time)
            rays += shadow_rays
            record_light(log, row, DIRECT, path.radiance)

        u = draw_scattering(stream, path.number)
        wi, weight, pdf, eta2 = sample_material(material, vertex.wo, u[2], (u[0], u[1]))
        if pdf > _ZERO and not _is_mirror(material):
            break
        sample = BsdfSample(wi, weight, _ZERO, eta2, _ONE)
        last = LastVertex(surface.point, vertex.normal, u32(surface.object))
        ray, path, bounce = scatter(surface, vertex.frame, ray, path, sample, _ONE, options)
        crossings = cross_surface(scene, surface, crossings, bounce, _YES)
        if vec.maximum(path.throughput) <= _ZERO or path.number - path.depth > _MAX_AGAIN:
            break
        after = where_present(scene.has.textures, FROM_ORIGIN)
    return path.radiance, rays


@template
def _add_direct(scene, stack, vertex, path, crossings, options, stream, time):
    """Adds direct light at a path's vertex; returns (the path with that light, number of shadow rays)."""
    surface = vertex.surface
    s, t, n = vertex.frame
    rays = 0
    count = options.light_samples
    for k in range(count):
        numbers = draw_light(substream(stream, k, count), path.number)
        light = _look_at_light(scene, surface.point, vertex.normal, count == 1, numbers[2], (numbers[0], numbers[1]), time)
        if light.pdf > _ZERO and vec.maximum(light.radiance) > _ZERO:
            wi = vec.to_local(s, t, n, light.direction)
            f, _ = eval_material(vertex.material, vertex.wo, wi)
            if vec.maximum(f) > _ZERO:
                start = offset_ray_origin(surface, wi[2] > _ZERO, light.direction)
                rays += 1
                left = layers_left(crossings.counts, options)
                weight = transmittance(scene, stack, start, light.end, options.transparent, left, time, shadow_root(scene.bvh))
                weight /= light.pdf * np.float32(count)
                if options.mistake != NO_MISTAKE:
                    weight *= mistake_factor(options.mistake, surface.point, light.end)
                path = _add(path, vec.scale(vec.mul(f, light.radiance), weight))
    return path, rays
