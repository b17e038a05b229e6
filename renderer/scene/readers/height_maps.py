"""Converts height maps to normal maps.

The normal map contains slopes for a surface as large as its UV range; the map's strength multiplies the slopes, and so accounts
for the surface's actual size. One normal map therefore serves all meshes with the same height map. Source: Blinn, "Simulation
of wrinkled surfaces", SIGGRAPH 1978.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.scene.description import F32, Image, Mesh, Texture
from renderer.scene.readers.linear_images import encoded, linear
from renderer.scene.textures import TextureShelf

__all__ = ["MOST_STRENGTH", "BumpMaps", "Bumps", "rounded", "spans_of"]

F64 = npt.NDArray[np.float64]
MOST_STRENGTH = 100.0
_MEASURED = 200_000  # maximum number of triangles sampled per mesh
_ASPECTS = 1.05  # ratio of aspect ratios above which meshes get separate maps
_MOST_ASPECT = 1e6
_LENGTH_RATIO = 1.02
_MAX_RELATIVE_SLOPE = 3.0  # largest encoded slope, in multiples of the RMS slope; steeper ones lose precision


class Bumps(NamedTuple):
    """A normal map: the index of its texture, and the strength to apply."""

    texture: int
    strength: float


def spans_of(mesh: Mesh, uv_set: int, place: F64) -> tuple[float, float] | None:
    """Returns the mean lengths, on a mesh, of one unit of u and of one unit of v; None if the mesh lacks these UVs.

    place: (3, 3) linear transform applied to the mesh.
    """
    uvs = mesh.uvs if uv_set == 0 else mesh.uvs1
    if uvs is None or not len(mesh.triangles):
        return None
    corners = mesh.triangles[:: -(-len(mesh.triangles) // _MEASURED)]
    at, uv = mesh.positions[corners].astype(np.float64) @ place.T, uvs[corners].astype(np.float64)
    p, q = at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]
    a, b = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    sound = np.abs(area) > 1e-20
    if not sound.any():
        return None
    p, q, a, b, area = (each[sound] for each in (p, q, a, b, area))
    with np.errstate(all="ignore"):  # overflow is handled as non-finite below
        u, v = _mean_lengths(p, q, a, b, area)
    return (u, v) if np.isfinite(u * v) and u * v > 0 else None


def _mean_lengths(p: F64, q: F64, a: F64, b: F64, area: F64) -> tuple[float, float]:
    """Returns the area-weighted mean lengths per unit of u and of v.

    p, q: two edges of each triangle; a, b: the same edges in UV space; area: the cross product of a and b.
    """
    along = (p * b[:, 1:2] - q * a[:, 1:2]) / area[:, None]
    down = (q * a[:, :1] - p * b[:, :1]) / area[:, None]
    weight = np.linalg.norm(np.cross(p, q), axis=1)
    total = float(weight.sum())
    u, v = (float((np.linalg.norm(each, axis=1) * weight).sum()) / total if total > 0 else 0.0 for each in (along, down))
    return u, v


def rounded(span: float) -> float:
    """Returns a length rounded to a geometric series with steps of 2 %, so that meshes of similar size share a material."""
    return float(_LENGTH_RATIO ** round(math.log(span) / math.log(_LENGTH_RATIO)))


class BumpMaps:
    """Makes normal maps from a description's height maps; each normal map is made once."""

    def __init__(self, shelf: TextureShelf, channels: tuple[float, float, float] = (1.0, 0.0, 0.0)) -> None:
        """Creates an empty collection. channels: weights of red, green and blue in the height."""
        self._shelf, self._channels = shelf, np.array(channels, np.float32)
        self._made: dict[tuple[int, int], tuple[int, float] | None] = {}

    def normal_map(self, heights: int, rise: float, spans: tuple[float, float]) -> Bumps | None:
        """Returns the normal map of a height texture; None if the texture is flat.

        rise: height that the value 1 represents, in the unit of `spans`; spans: lengths from `spans_of`.
        """
        aspect = min(max(spans[1] / spans[0], 1 / _MOST_ASPECT), _MOST_ASPECT)
        step = round(math.log(aspect) / math.log(_ASPECTS))
        key = heights, step
        if key not in self._made:
            self._made[key] = self._make_normal_map(heights, step)
        found = self._made[key]
        if found is None:
            return None
        strength = found[1] * rise / spans[0]
        return Bumps(found[0], min(max(strength, -MOST_STRENGTH), MOST_STRENGTH))

    def _make_normal_map(self, heights: int, step: int) -> tuple[int, float] | None:
        """Returns the index of a normal map made from a height texture, and the slope that the map's value 1 represents.

        step: the ratio of the lengths per unit of v and of u, as a number of logarithmic steps. Returns None if the texture is
        flat.
        """
        texture = self._shelf.texture_of(heights)
        with np.errstate(all="ignore"):
            slopes = _slopes(linear(self._shelf.image_of(heights)) @ self._channels, texture)
            slopes[..., 1] /= np.float32(_ASPECTS**step)
            size = _MAX_RELATIVE_SLOPE * math.sqrt(float((slopes**2).mean(dtype=np.float64)))
        if not (size > 0 and math.isfinite(size)):
            return None
        what = f"normals of heights {step} {texture.transform} {texture.wrap_s} {texture.wrap_t}"
        made = self._shelf.derived_texture(heights, what, lambda it: _as_normals(it, slopes / np.float32(size)))
        return None if made is None else (made, size)


def _slopes(height: F32, texture: Texture) -> F32:
    """Returns the (h, w, 2) derivatives of height with respect to the mesh's u and v, v downwards."""
    rows, columns = height.shape
    x = columns * _differences(height, 1, texture.wrap_s == "repeat")
    y = rows * _differences(height, 0, texture.wrap_t == "repeat")
    a, b, _, c, d, _ = texture.transform
    return np.stack([a * x + c * y, b * x + d * y], axis=-1).astype(np.float32)


def _differences(height: F32, axis: int, repeats: bool) -> F32:
    """Returns central differences between pixels; one-sided at the edges of a texture that does not repeat."""
    if height.shape[axis] == 1:
        return np.zeros_like(height)
    if repeats:
        return np.asarray((np.roll(height, -1, axis) - np.roll(height, 1, axis)) / np.float32(2))
    return np.asarray(np.gradient(height, axis=axis))


def _as_normals(heights: Image, slopes: F32) -> Image:
    """Returns slopes as a glTF normal map (green up), with the bit depth of the height map."""
    normals = np.stack([-slopes[..., 0], slopes[..., 1], np.ones(slopes.shape[:2], np.float32)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    values = np.concatenate([0.5 + 0.5 * normals, np.ones_like(normals[..., :1])], axis=-1)
    return Image(f"{heights.name} as normals", encoded(values, heights), srgb=False)
