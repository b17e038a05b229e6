"""Next-event estimation: the contribution of one light sample at a vertex, and the shadow ray towards the light."""

from __future__ import annotations

import numpy as np

from renderer.jit import device
from renderer.kernel import vec
from renderer.kernel.medium.medium_stack import crossed
from renderer.kernel.steps.emitted_light import clamp_indirect
from renderer.kernel.steps.state import ShadowRay
from renderer.kernel.surface.ray_origins import offset_ray_origin
from renderer.wide.values import where

__all__ = ["add_direct_light", "direct_light", "media_beyond", "sample_direct_light"]

_ZERO = np.float32(0.0)
_TWO = np.float32(2.0)
_FIRST = np.uint32(0)


@device
def media_beyond(scene, surface, medium_stack, is_surface):
    """Returns the stack of media behind the surface at a vertex; for a vertex in a medium, the stack unchanged."""
    material = where(is_surface, surface.material, _FIRST)
    return where(is_surface, crossed(scene, medium_stack, material, surface.front), medium_stack)


@device
def sample_direct_light(scene, surface, path, light, wi, f, weight, medium_stack, is_surface):
    """Returns the ShadowRay towards a light sample, with the light's contribution.

    wi: direction of the light in the shading frame. f: f |cos| for wi. weight: the sample's MIS weight. medium_stack: the media
    on the viewer's side of the surface. is_surface: False for a vertex in a medium.
    """
    brought = vec.mul(path.throughput, vec.scale(vec.mul(f, light.radiance), weight / light.pdf))
    above = wi[2] > _ZERO
    start = offset_ray_origin(surface, above, light.direction)
    is_cast = (light.pdf > _ZERO) & (vec.maximum(light.radiance) > _ZERO) & (vec.maximum(f) > _ZERO)
    begins_in = medium_stack
    if scene.has.media is not None:
        begins_in = where(above, medium_stack, media_beyond(scene, surface, medium_stack, is_surface))
    return ShadowRay(start, light.end, is_cast, brought, path.depth + _TWO, begins_in)


@device
def direct_light(brought, left, segments, options):
    """Returns what direct light adds to a path's radiance; see `add_direct_light`."""
    return clamp_indirect(vec.mul(brought, left), segments, options.clamp)


@device
def add_direct_light(radiance, brought, left, segments, options):
    """Returns the radiance of a path with direct light added, clamped if it is indirect.

    brought: the light if it is not occluded. left: transmittance of the shadow ray, rgb. segments: number of the path's segments.
    """
    return vec.add(radiance, direct_light(brought, left, segments, options))
