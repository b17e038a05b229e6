"""Catchers of reflections: what the first ray that a path sends from one of them finds, apart from objects.

A catcher's light is that of the plate, the photograph on which the picture is laid: of the environment, suns and lamps. Rays from
it sample the environment with MIS, and suns and lamps only where light samples cannot find them. What they meet else is an
object, whose light the film shows; `unshadowed` of FirstHit then gets the light that it hides, and `shadowed` what arrives.
"""

from __future__ import annotations

import numpy as np

from renderer.arrays.rows import CATCHER, REFLECTIONS
from renderer.jit import device, template
from renderer.kernel import vec
from renderer.kernel.material.material import has_flag
from renderer.kernel.spectrum.upsampling import light_at
from renderer.kernel.spectrum.wavelengths import rgb_at
from renderer.kernel.steps.emitted_light import add_light, background_counts, emitted_by_environment, emitted_by_sun
from renderer.kernel.steps.state import with_radiance
from renderer.wide.values import not_, where, zero_like

__all__ = [
    "background_light",
    "branches_at_catcher",
    "catches_reflections",
    "ignores_shadows",
    "is_from_catcher",
    "luminance_on_film",
]

_ZERO, _ONE = np.float32(0.0), np.float32(1.0)
_CATCHER, _REFLECTIONS = np.uint32(CATCHER), np.uint32(REFLECTIONS)
_FIRST = np.uint32(0)  # in place of the material of vertices in media


@device
def catches_reflections(scene, caught, material):
    """Returns True if the vertex is on a catcher, `caught`, whose material catches reflections."""
    return caught & has_flag(scene, where(caught, material, _FIRST), _REFLECTIONS)


@device
def ignores_shadows(scene, caught, material):
    """Returns True if the vertex is on a catcher, `caught`, whose material catches reflections and no shadows."""
    catches_shadows = has_flag(scene, where(caught, material, _FIRST), _CATCHER)
    return catches_reflections(scene, caught, material) & not_(catches_shadows)


@device
def is_from_catcher(path, caught):
    """Returns True if the path's ray is the first one from a catcher. caught: of the path's FirstHit."""
    return (path.number == _ONE) & (caught > _ZERO)


@device
def branches_at_catcher(scene, choice, alone):
    """Returns the number of directions scattered at a catcher of reflections that can find the sampled light, for its MIS weight.

    choice: the random number that selected the light. alone: whether rays cannot hit it.
    """
    none = zero_like(choice)
    return where((choice < scene.environment_frame[3]) & not_(alone), none + _ONE, none)


@device
def luminance_on_film(scene, stream, light):
    """Returns the luminance of a path's light as the film adds it. stream: of the sample's camera ray."""
    return vec.luminance(rgb_at(scene, stream, light))


@template
def background_light(scene, ray, path, last, kind, time, wavelengths, options, weigh_hit):
    """Returns the radiance that a ray from a catcher would bring from beyond the scene if nothing were in its way.

    last: the LastVertex. kind: of the ray, from its Crossings. weigh_hit: as for `trace_path`.
    """
    counts, none = background_counts(ray, path, options), zero_like(ray.pdf)
    seen = emitted_by_environment(scene, ray)
    weight = weigh_hit(options, ray, path, last, None, seen.light_pdf)
    found = with_radiance(path, (none, none, none))
    found = add_light(found, vec.scale(light_at(scene, seen.radiance, wavelengths), weight), counts, options)
    if scene.has.lights is not None:
        for which in range(len(scene.sun)):
            seen = emitted_by_sun(scene, which, ray, last, path.number, kind, time)
            found = add_light(found, light_at(scene, seen.radiance, wavelengths), counts & (ray.pdf == _ZERO), options)
    return found.radiance
