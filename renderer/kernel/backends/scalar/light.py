"""Light found by a single path: emission that its ray hits, and light samples at its vertices.

`weigh_hit` and `weigh_light` are functions that return MIS weights; see `trace_path` in path.py.
"""

from __future__ import annotations

import numpy as np

from renderer.jit import device, template
from renderer.kernel import vec
from renderer.kernel.backends.scalar.visibility import shadow_transmittance
from renderer.kernel.light.lights import sample_light
from renderer.kernel.material.material import eval_material
from renderer.kernel.sampling.sampler import substream
from renderer.kernel.steps.aim import NOT_AIMED, mixture_pdf, targets_in_view
from renderer.kernel.steps.emitted_light import add_light, emitted_by_environment, emitted_by_sun, emitted_light
from renderer.kernel.steps.mis import branches_to_light
from renderer.kernel.steps.pass_through import counts_emission
from renderer.kernel.steps.random_blocks import draw_light
from renderer.kernel.steps.sample_direct_light import add_direct_light, sample_direct_light
from renderer.kernel.steps.state import LastVertex, with_radiance
from renderer.kernel.surface.surface import is_emissive

__all__ = ["add_direct", "add_emission", "add_environment", "has_lights"]

_ZERO = np.float32(0.0)
_YES, _NO = np.bool_(True), np.bool_(False)


@device
def has_lights(scene):
    """Returns True if the scene has anything that next-event estimation can sample."""
    return scene.environment_frame[3] > _ZERO or len(scene.light_primitive) > 0


@template
def add_environment(scene, ray, path, last, options, time, weigh_hit):
    """Returns `path` with the light of the environment and of suns added; called if the path's ray has hit nothing."""
    counts = ray.pdf >= _ZERO
    seen = emitted_by_environment(scene, ray)
    path = add_light(path, vec.scale(seen.radiance, weigh_hit(options, ray, path, last, None, seen.light_pdf)), counts, options)
    if scene.has.lights is not None:
        for which in range(len(scene.sun)):
            seen = emitted_by_sun(scene, which, ray, last, path.number, time)
            weight = weigh_hit(options, ray, path, last, None, seen.light_pdf)
            path = add_light(path, vec.scale(seen.radiance, weight), counts, options)
    return path


@template
def add_emission(scene, surface, through, ray, path, last, options, time, weigh_hit):
    """Returns `path` with the emission of the surface that its ray has hit added.

    through: whether the path passes through that surface without scattering.
    """
    if is_emissive(surface) and ray.pdf >= _ZERO and counts_emission(scene, surface, through):
        seen = emitted_light(scene, surface, _YES, ray, last, time)
        weight = weigh_hit(options, ray, path, last, surface.point, seen.light_pdf)
        path = add_light(path, vec.scale(seen.radiance, weight), _YES, options)
    return path


@template
def add_direct(scene, stack, vertex, path, crossings, is_surface, options, stream, time, weigh_light):
    """Samples the direct light at a path's vertex; returns (the path with that light added, number of shadow rays)."""
    surface = vertex.surface
    s, t, n = vertex.frame
    rays = 0
    count = options.light_samples if path.number == _ZERO else 1
    for k in range(count):
        numbers = draw_light(substream(stream, k, count) if count > 1 else stream, path.number)
        light = sample_light(scene, surface.point, vertex.normal, numbers[2], (numbers[0], numbers[1]), time)
        if light.pdf > _ZERO:
            wi = vec.to_local(s, t, n, light.direction)
            f, scatter_pdf = eval_material(vertex.material, vertex.wo, wi)
            if scene.has.targets is not None:
                here = LastVertex(surface.point, vertex.normal)
                targets = targets_in_view(scene, here, surface.material, _NO, is_surface, options)
                scatter_pdf = mixture_pdf(scene, here, targets, light.direction, scatter_pdf, NOT_AIMED)
            branches = branches_to_light(light.alone, path.number, options)
            weight = weigh_light(options, light, scatter_pdf, branches, surface.point) / np.float32(count)
            shadow = sample_direct_light(scene, surface, path, light, wi, f, weight, crossings.medium_stack, is_surface)
            if shadow.is_cast:
                rays += 1
                left = shadow_transmittance(scene, stack, shadow, crossings.counts, options, time)
                if vec.maximum(left) > _ZERO:
                    radiance = add_direct_light(path.radiance, shadow.brought, left, shadow.segments, options)
                    path = with_radiance(path, radiance)
    return path, rays
