"""Computes surfaces, texture colours and material parameters at the vertices of eight paths."""

from __future__ import annotations

import numpy as np

from renderer.arrays.rows import BASE_TEXTURE, METALLIC_ROUGHNESS_TEXTURE, SLOTS, TEXTURED
from renderer.bvh.traverse import Hit
from renderer.jit import device, never_inline, subroutine
from renderer.kernel.material.images import image_colors, is_rare
from renderer.kernel.material.material import has_flag, texture_factors
from renderer.kernel.surface.surface import Surface, triangle_at
from renderer.wide.lanes import each_lane
from renderer.wide.values import any_of, as_wide, lookup, u32, where, where3

__all__ = ["surfaces_at", "texture_factors_of"]

_ONE = np.float32(1.0)
_NONE = np.uint32(0)
_NO_TEXTURE = np.uint32(2**32 - 1)
_TEXTURED = np.uint32(TEXTURED)


@subroutine
def _one_surface(scene, d, t, primitive, u, v, instance, time):
    """Returns the surface at one ray's triangle hit, computed by `triangle_at`, as nested tuples of numbers."""
    never_inline()
    s = triangle_at(scene, d, Hit(t, primitive, u, v, np.int32(instance), time))
    shape = s.point, s.error, s.geometric, s.shading, s.uv, s.front
    return shape, s.material, s.light, s.object, s.uv1, s.color, s.tangent, s.smooth, s.lift


@device
def _one_by_one(scene, time):
    if time is not None and len(scene.key_position) > 0:
        return True
    return len(scene.to_world) > 0


@device
def surfaces_at(scene, d, hit):
    """Returns the surfaces at the triangle hits of eight rays, computed by `triangle_at`.

    If the scene has instances or moving meshes, they are computed one at a time.
    """
    if scene.has.instances is not None and _one_by_one(scene, hit.time):
        every = hit.t == hit.t
        arguments = scene, d, hit.t, hit.primitive, hit.u, hit.v, hit.instance, hit.time
        shape, material, light, number, uv1, color, tangent, smooth, lift = each_lane(_one_surface, every, arguments)
        point, error, geometric, shading, uv, front = shape
        return Surface(point, error, geometric, shading, uv, front, material, light, number, uv1, color, tangent, smooth, lift)
    return triangle_at(scene, d, Hit(hit.t, hit.primitive, hit.u, hit.v, None, None))


@device
def _textures_move(scene, time):
    if time is not None and len(scene.key_texture) > 0:  # noqa: SIM103 - under an `if`, what has no time is left out
        return True
    return False


@device
def _image_factors(scene, number, there, surface):
    """Returns the colours of eight textures, each at one of eight surfaces; white in lanes where `there` is False.

    number: the textures' indices in the scene.
    """
    one = as_wide(_ONE, surface.error)
    color = one, one, one
    if any_of(there):
        color = where3(there, image_colors(scene, where(there, number, _NONE), surface.uv, surface.uv1), color)
    return color


@device
def texture_factors_of(scene, surface, time):
    """Returns the texture factors (colour, metallic, roughness) of eight surfaces; 1 for materials without textures."""
    one = as_wide(_ONE, surface.error)
    color, metallic, roughness = (one, one, one), one, one
    if scene.has.textures is not None:
        textured = has_flag(scene, surface.material, _TEXTURED)
        if any_of(textured):
            slots = surface.material * np.uint32(SLOTS)
            base = u32(lookup(scene.material_texture, slots + np.uint32(BASE_TEXTURE)))
            other = u32(lookup(scene.material_texture, slots + np.uint32(METALLIC_ROUGHNESS_TEXTURE)))
            of_base, of_other = textured & (base != _NO_TEXTURE), textured & (other != _NO_TEXTURE)
            stacked = of_base & is_rare(scene, where(of_base, base, _NONE))
            stacked = stacked | of_other & is_rare(scene, where(of_other, other, _NONE))
            if any_of(stacked) or _textures_move(scene, time):
                arguments = scene, surface.material, surface.uv, surface.uv1, time
                rgb, of_metallic, of_roughness = each_lane(texture_factors, textured, arguments)
                color = where3(textured, rgb, color)
                metallic, roughness = where(textured, of_metallic, one), where(textured, of_roughness, one)
            else:
                _, roughness, metallic = _image_factors(scene, other, of_other, surface)
                color = _image_factors(scene, base, of_base, surface)
    return color, metallic, roughness
