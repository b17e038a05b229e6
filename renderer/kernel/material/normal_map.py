"""Shading frames: the shading normal perturbed by a normal map, and the tangent."""

from __future__ import annotations

import math

import numpy as np

from renderer.arrays.rows import (
    CLEARCOAT_NORMAL_SCALE,
    CLEARCOAT_NORMAL_TEXTURE,
    NEEDS_TANGENT,
    NORMAL_MAPPED,
    NORMAL_SCALE,
    NORMAL_TEXTURE,
)
from renderer.jit import device, subroutine
from renderer.kernel import vec
from renderer.kernel.material.texture import sample_texture
from renderer.kernel.surface.consistent_normals import consistent_normal
from renderer.wide.lanes import each_lane
from renderer.wide.values import any_of, lookup, u32, where3

__all__ = ["bent_frame", "coat_normal", "map_normal", "shading_frame"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_TWO = np.float32(2.0)
_NEEDS_FRAME, _NONE = np.uint32(NORMAL_MAPPED | NEEDS_TANGENT), np.uint32(0)
_LEAST_TANGENT = np.float32(1e-4)


@subroutine
def _tangents(n, tangent):
    """Returns unit vectors (s, t) orthogonal to n, s along the tangent. tangent: xyz and the bitangent's sign."""
    along = (tangent[0], tangent[1], tangent[2])
    s = vec.sub(along, vec.scale(n, vec.dot(n, along)))
    square = vec.dot(s, s)
    if not square > _LEAST_TANGENT:
        return vec.basis(n)
    s = vec.scale(s, _ONE / math.sqrt(square))
    t = vec.cross(n, s)
    return s, vec.scale(t, math.copysign(_ONE, tangent[3]))


@subroutine
def _read_normal(color, strength, s, t, n):
    """Returns the unit normal encoded by a texel's linear values in the frame (s, t, n); n if all values are 1/2."""
    x = (_TWO * color[0] - _ONE) * strength
    y = (_TWO * color[1] - _ONE) * strength
    z = _TWO * color[2] - _ONE
    square = x * x + y * y + z * z
    if not square > _ZERO:
        return n
    inverse = _ONE / math.sqrt(square)
    return vec.to_world(s, t, n, (x * inverse, y * inverse, z * inverse))


@subroutine
def map_normal(color, strength, s, t, n, geometric, wo):
    """Returns the unit normal encoded by a texel, adjusted to be consistent with the geometric normal and the view direction wo.

    color: the texel's linear values, in the frame (s, t, n). strength: factor of the encoded x and y.
    """
    return consistent_normal(_read_normal(color, strength, s, t, n), geometric, wo)


@device
def shading_frame(scene, surface, wo, time):
    """Returns the orthonormal shading frame (s, t, n): n on the viewer's side, s along the tangent where the material needs it.

    The frame is left-handed where the texture is mirrored. wo: unit, towards the viewer, in world space. time: shutter time, 0
    ... 1; None for a scene without motion. For one path or for eight lanes.
    """
    n = surface.shading
    s, t = vec.basis(n)
    if scene.has.textures is not None:
        bent = (u32(lookup(scene.material_flags, surface.material)) & _NEEDS_FRAME) != _NONE
        if any_of(bent):
            turned = (surface.front, surface.tangent, surface.uv, surface.uv1, surface.geometric, n, wo, time)
            along, across, up = each_lane(bent_frame, bent, (scene, surface.material, *turned))
            s, t, n = where3(bent, along, s), where3(bent, across, t), where3(bent, up, n)
    return s, t, n


@device
def bent_frame(scene, material, front, tangent, uv, uv1, geometric, n, wo, time):
    """Returns the shading frame (s, t, n) for a material with a normal map or tangents.

    The arguments are fields of a Surface; n is the shading normal before normal mapping.
    """
    # Seen from behind, the frame is inverted: bumps of the map become dents.
    sign = _ONE if front else -_ONE
    s, t = _tangents(n, (tangent[0] * sign, tangent[1] * sign, tangent[2] * sign, tangent[3] * sign))
    if scene.material_flags[material] & NORMAL_MAPPED == 0:
        return s, t, n
    texel = sample_texture(scene, scene.material_texture[material, NORMAL_TEXTURE], uv, uv1, time)
    color = (texel[0], texel[1], texel[2])
    n = map_normal(color, scene.material[material, NORMAL_SCALE], s, t, n, geometric, wo)
    s, t = _tangents(n, (s[0], s[1], s[2], tangent[3] * sign))
    return s, t, n


@device
def coat_normal(scene, material, shading, uv, uv1, frame, time):
    """Returns the clearcoat's unit normal in the shading frame: from its normal map, else the surface's normal `shading`."""
    s, t, n = frame
    normal = shading
    texture = scene.material_texture[material, CLEARCOAT_NORMAL_TEXTURE]
    if texture >= 0:
        along, across = _tangents(normal, (s[0], s[1], s[2], vec.dot(vec.cross(n, s), t)))
        r, g, b, _ = sample_texture(scene, texture, uv, uv1, time)
        normal = _read_normal((r, g, b), scene.material[material, CLEARCOAT_NORMAL_SCALE], along, across, normal)
    return vec.to_local(s, t, n, normal)
