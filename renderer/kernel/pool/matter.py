"""Materials at vertices in scenes with textures, normal maps, alpha, absorption or dispersion.

Rare features are looked up one path at a time, by the functions of the single-path integrators.
"""

from __future__ import annotations

import numpy as np

from renderer.arrays.rows import (
    ABSORBING,
    ABSORPTION,
    BASE,
    BASE_TEXTURE,
    COLUMNS,
    DISPERSIVE,
    LAMP,
    METALLIC,
    METALLIC_ROUGHNESS_TEXTURE,
    NEEDS_TANGENT,
    NORMAL_MAPPED,
    ROUGHNESS,
    SLOTS,
    TEXTURED,
    TRANSMITS,
    TRANSPARENT,
)
from renderer.bvh.traverse import Hit
from renderer.jit import device, out_of_line, subroutine
from renderer.kernel import vec
from renderer.kernel.fetch import columns
from renderer.kernel.integrators.transport import COLOR_BLOCK, PASSING_BLOCK, PASSING_BLOCKS, absorbed
from renderer.kernel.material.images import image_colors, is_rare
from renderer.kernel.material.material import colored_index, opacity, texture_factors
from renderer.kernel.material.normal_map import bent_frame
from renderer.kernel.pool.rows import AXES, MAPPED, MATTER, PLACE, few, write
from renderer.kernel.sampling.sampler import draw4
from renderer.kernel.surface.surface import Surface, triangle_at
from renderer.wide.lanes import each_lane
from renderer.wide.values import any_of, as_wide, lookup, nil, not_, to_int, u32, where, where3

__all__ = ["attenuated", "keep_matter", "lamps", "passes", "surfaces_at"]

_ZERO = np.float32(0.0)
_ONE = np.float32(1.0)
_NONE = np.uint32(0)
_NO_TEXTURE = np.uint32(2**32 - 1)
_TEXTURED, _BENT = np.uint32(TEXTURED), np.uint32(NORMAL_MAPPED | NEEDS_TANGENT)
_TRANSMITS, _TRANSPARENT, _ABSORBING, _DISPERSIVE = (
    np.uint32(TRANSMITS),
    np.uint32(TRANSPARENT),
    np.uint32(ABSORBING),
    np.uint32(DISPERSIVE),
)
_LAMP = np.uint32(LAMP)
_PASSING_BLOCK, _COLOR_BLOCK = np.uint32(PASSING_BLOCK), np.uint32(COLOR_BLOCK)


@device
def _flagged(scene, material, flag):
    return (u32(lookup(scene.material_flags, material)) & flag) != _NONE


@subroutine
def _one_surface(scene, d, t, primitive, u, v, instance, time):
    """Returns `triangle_at` of one ray, as numbers in tuples."""
    out_of_line()
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
    """Returns `triangle_at` for eight rays, some of which may have hit triangles of instances or of moving meshes."""
    if scene.has.instances is not None and _one_by_one(scene, hit.time):
        every = hit.t == hit.t
        arguments = scene, d, hit.t, hit.primitive, hit.u, hit.v, hit.instance, hit.time
        shape, material, light, number, uv1, color, tangent, smooth, lift = each_lane(_one_surface, every, arguments)
        point, error, geometric, shading, uv, front = shape
        return Surface(point, error, geometric, shading, uv, front, material, light, number, uv1, color, tangent, smooth, lift)
    return triangle_at(scene, d, Hit(hit.t, hit.primitive, hit.u, hit.v, None, None))


@device
def lamps(scene, surface):
    """Returns a mask of the surfaces that emit light and let rays pass unchanged."""
    return _flagged(scene, surface.material, _LAMP)


@device
def passes(scene, surface, stream, row, options, time):
    """Returns a mask of the paths that pass through their surfaces, by alpha or as lamps.

    row: surfaces hit before by each path.
    """
    through = surface.error != surface.error
    if scene.has.textures is not None:
        through = lamps(scene, surface)
    if scene.has.textures is not None and options.transparent:
        may = _flagged(scene, surface.material, _TRANSPARENT)
        if any_of(may):
            u = draw4(stream, (to_int(row) & PASSING_BLOCKS) + _PASSING_BLOCK)[0]
            faint = u >= opacity(scene, surface.material, surface.uv, surface.uv1, surface.color[3], time)
            through = through | (may & faint)
    return through


@device
def attenuated(scene, surface, through, throughput, pool, rows):
    """Returns the throughput after absorption between the last vertex and the surface, inside the surface's material."""
    if scene.has.layers is not None and scene.has.media is None:  # with media it is included in the free flights
        inside = not_(surface.front | through) & _flagged(scene, surface.material, _ABSORBING)
        if any_of(inside):
            taken = columns(scene.material, surface.material, COLUMNS, ABSORPTION, 3)
            left = absorbed(throughput, taken, few(pool, rows, PLACE, 3), surface.point)
            throughput = where3(inside, left, throughput)
    return throughput


@device
def _textures_move(scene, time):
    if time is not None and len(scene.key_texture) > 0:  # noqa: SIM103 - under an `if`, what has no time is left out
        return True
    return False


@device
def _image_factors(scene, number, there, surface):
    """Returns the colours of eight textures, white where `there` is false. number: the textures' numbers."""
    one = as_wide(_ONE, surface.error)
    color = one, one, one
    if any_of(there):
        color = where3(there, image_colors(scene, where(there, number, _NONE), surface.uv, surface.uv1), color)
    return color


@device
def _texture_factors(scene, surface, textured, time):
    """Returns `texture_factors`, (colour, metallic, roughness), of eight surfaces where they are `textured`; else 1."""
    slots = surface.material * np.uint32(SLOTS)
    base = u32(lookup(scene.material_texture, slots + np.uint32(BASE_TEXTURE)))
    other = u32(lookup(scene.material_texture, slots + np.uint32(METALLIC_ROUGHNESS_TEXTURE)))
    of_base, of_other = textured & (base != _NO_TEXTURE), textured & (other != _NO_TEXTURE)
    stacked = of_base & is_rare(scene, where(of_base, base, _NONE)) | of_other & is_rare(scene, where(of_other, other, _NONE))
    if any_of(stacked) or _textures_move(scene, time):
        return each_lane(texture_factors, textured, (scene, surface.material, surface.uv, surface.uv1, time))
    _, roughness, metallic = _image_factors(scene, other, of_other, surface)
    return _image_factors(scene, base, of_base, surface), metallic, roughness


@device
def keep_matter(scene, pool, rows, surface, through, wo, stream, number, throughput, time):
    """Looks up the vertices' materials and writes them to the rows: returns (colour, roughness, shading normal, throughput)."""
    n = surface.shading
    roughness = columns(scene.material, surface.material, COLUMNS, ROUGHNESS, 1)[0]
    base = columns(scene.material, surface.material, COLUMNS, BASE, 3)
    if scene.has.textures is not None:
        metallic, _, ior = columns(scene.material, surface.material, COLUMNS, METALLIC, 3)
        textured = _flagged(scene, surface.material, _TEXTURED)
        if any_of(textured):
            color, of_metallic, of_roughness = _texture_factors(scene, surface, textured, time)
            base = where3(textured, vec.mul(base, color), base)
            metallic = where(textured, metallic * of_metallic, metallic)
            roughness = where(textured, roughness * of_roughness, roughness)
        base = vec.mul(base, (surface.color[0], surface.color[1], surface.color[2]))
        s, t = vec.basis(n)
        bent = _flagged(scene, surface.material, _BENT)
        if any_of(bent):
            turned = (surface.front, surface.tangent, surface.uv, surface.uv1, surface.geometric, n, wo, time)
            along, across, up = each_lane(bent_frame, bent, (scene, surface.material, *turned))
            s, t, n = where3(bent, along, s), where3(bent, across, t), where3(bent, up, n)
        parted = _flagged(scene, surface.material, _DISPERSIVE) & (vec.maximum(throughput) > _ZERO) & not_(through)
        if any_of(parted):
            u = draw4(stream, to_int(number) + _COLOR_BLOCK)[0]
            own, seen = each_lane(colored_index, parted, (scene, surface.material, throughput, u))
            ior = where(parted, own, ior)
            throughput = where3(parted, seen, throughput)
        eta = where(surface.front, ior, _ONE / ior)
        none = nil(eta)
        write(pool, rows, MATTER, (*base, metallic, roughness, eta, *surface.uv))
        write(pool, rows, AXES, (*s, *t, *surface.uv1))
        side = where3(_flagged(scene, surface.material, _TRANSMITS), (none, none, none), n)
        if any_of(through):
            side = where3(through, few(pool, rows, MAPPED + np.uintp(3), 3), side)  # keeps the last vertex's normal
        write(pool, rows, MAPPED, (*n, *side, none, none))
    return base, roughness, n, throughput
