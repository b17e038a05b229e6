"""The compiled scene: the flat arrays that the kernel reads, and the one safetensors file that keeps them.

Every array is C-contiguous and read-only (Numba compiles read-only arrays as a type of their own, so that one rule keeps
one compiled kernel for memory-mapped and freshly built scenes alike). A primitive's number is its triangle's index, or
T + its sphere's index.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy.typing as npt

from renderer.bvh.layout import Bvh

__all__ = ["CompiledScene"]

Array = npt.NDArray[Any]


class CompiledScene(NamedTuple):
    """What the kernel reads. V vertices, T triangles, S spheres, M materials, X textures, L lights."""

    bvh: Bvh

    position: Array  # (V, 3) f32, world space
    normal: Array  # (V, 3) f32, unit shading normals (the geometric one where the mesh is flat)
    uv: Array  # (V, 2) f32
    triangle: Array  # (T, 3) i32 into the vertices
    triangle_material: Array  # (T,) i32
    triangle_light: Array  # (T,) i32: its light, or -1
    sphere: Array  # (S, 4) f32: centre, radius
    sphere_material: Array  # (S,) i32
    sphere_light: Array  # (S,) i32: its light, or -1

    material_kind: Array  # (M,) i32: renderer.kernel.material's DIFFUSE, MIRROR, GLASS, METALLIC_ROUGHNESS
    material: Array  # (M, 10) f32: base colour 3, emission 3, metallic, roughness, ior, double-sided (0/1)
    material_texture: Array  # (M, 3) i32: base colour, emission, metallic-roughness; -1 for none

    texture: Array  # (X, 6) i32: first texel, width, height, wrap s, wrap t (0 repeat 1 mirror 2 clamp), sRGB (0/1)
    texel: Array  # (N, 4) u8 RGBA, all textures one behind the other, rows from the top

    light_primitive: Array  # (L,) i32: the emitting primitive; environments are not in this list
    light_cdf: Array  # (L + 1,) f32: lights chosen by power, 0 ... 1
    light_area: Array  # (L,) f32

    environment: Array  # (H, W, 3) f32 radiance, colour and strength multiplied in; (1, 1, 3) if constant, zeros if none
    environment_marginal: Array  # (H + 1,) f32: cdf over rows, luminance times sin(theta)
    environment_conditional: Array  # (H, W + 1) f32: cdf within a row
    environment_frame: Array  # (4,) f32: cos and sin of the rotation, mean radiance, probability of choosing it over the lights

    bounds: Array  # (2, 3) f32: lower and upper corner of all geometry
