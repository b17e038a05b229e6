"""Computes how much light the primitives of a scene emit, including their textures."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.arrays import rows
from renderer.kernel.light.mean_emission import mean_texels
from renderer.luminance import luminance
from renderer.scene.geometry import NO_PLACEMENT, Geometry
from renderer.scene.lights import Emitters
from renderer.scene.material_packing import Packed

__all__ = ["emitting_triangles", "is_uniform_emitter"]

# Fraction of a mesh's light spread evenly over its triangles: a mean over few points may miss a bright texel.
_UNIFORM_FRACTION = 0.05


def emitting_triangles(packed: Packed, geometry: Geometry) -> Emitters:
    """Returns the emitting triangles of a geometry with the mean luminance that each emits, its texture included."""
    bright = np.flatnonzero((packed.emitted[geometry.material] > 0) & (geometry.object != NO_PLACEMENT))
    ranges = [np.arange(geometry.first[p], geometry.first[p + 1]) for p in bright]
    triangle = np.concatenate([np.zeros(0, np.int64), *ranges])
    material_of = np.repeat(geometry.material[bright], [len(r) for r in ranges])
    emitted = packed.emitted[material_of]
    order = np.argsort(material_of, kind="stable")
    textured = np.flatnonzero((packed.emitted > 0) & (packed.material_texture[:, rows.EMISSION_TEXTURE] >= 0))
    of_triangle = material_of[order]
    begins, ends = np.searchsorted(of_triangle, textured, "left"), np.searchsorted(of_triangle, textured, "right")
    for material, begin, end in zip(textured, begins, ends, strict=True):
        number = packed.material_texture[material, rows.EMISSION_TEXTURE]
        of_it = order[begin:end]
        if not len(of_it):
            continue
        mean = np.zeros((len(of_it), 3), np.float32)
        uv1 = geometry.uv1 if len(geometry.uv1) else geometry.uv
        table = packed.texture, packed.texture_transform, packed.texel
        mean_texels(*table, number, geometry.uv, uv1, geometry.triangle[triangle[of_it]], mean)
        factor = packed.material[material, rows.EMISSION : rows.EMISSION + 3].astype(np.float64)
        sides = 2.0 if packed.material[material, rows.DOUBLE_SIDED] else 1.0
        emitted[of_it] = (1 - _UNIFORM_FRACTION) * sides * luminance(mean * factor) + _UNIFORM_FRACTION * packed.emitted[material]
    shines = emitted > 0
    return Emitters(triangle[shines], material_of[shines], emitted[shines])


def is_uniform_emitter(packed: Packed, geometry: Geometry) -> npt.NDArray[np.bool_]:
    """Returns a mask (M,) of the materials that emit equally at every point: no texture, alpha or vertex colours."""
    if len(geometry.color):
        return np.zeros(len(packed.material_flags), bool)
    return packed.material_flags & (rows.TEXTURED | rows.TRANSPARENT) == 0
