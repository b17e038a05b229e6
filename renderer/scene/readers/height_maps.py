"""Pictures of heights as normal maps.

The map holds slopes for a surface that is as long as its coordinates; how long it is in truth is in the strength that goes
with the map, as that multiplies slopes. So one map serves all meshes that show the picture. Source of bump maps: Blinn,
"Simulation of wrinkled surfaces", SIGGRAPH 1978.
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
_MEASURED = 200_000  # triangles of a mesh that are looked at
_ASPECTS = 1.05  # by which two meshes are stretched otherwise that have maps of their own
_MOST_ASPECT = 1e6
_ALIKE = 1.02
_WITHIN = 3.0  # times the mean slope: what is steeper is told with less precision


class Bumps(NamedTuple):
    """A normal map, and what its strength is times on a surface whose coordinates are as long as they count."""

    texture: int
    strength: float


def spans_of(mesh: Mesh, uv_set: int, place: F64) -> tuple[float, float] | None:
    """How long the mesh is, placed by a matrix (3, 3), where its coordinates u and v grow by 1, on average; None: it has none."""
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
    with np.errstate(all="ignore"):  # what is too large to be measured is not finite below
        u, v = _means(p, q, a, b, area)
    return (u, v) if np.isfinite(u * v) and u * v > 0 else None


def _means(p: F64, q: F64, a: F64, b: F64, area: F64) -> tuple[float, float]:
    """Of triangles with the edges p and q, and these in UVs, how long u and v are, each triangle by its size."""
    along = (p * b[:, 1:2] - q * a[:, 1:2]) / area[:, None]
    down = (q * a[:, :1] - p * b[:, :1]) / area[:, None]
    weight = np.linalg.norm(np.cross(p, q), axis=1)
    total = float(weight.sum())
    u, v = (float((np.linalg.norm(each, axis=1) * weight).sum()) / total if total > 0 else 0.0 for each in (along, down))
    return u, v


def rounded(span: float) -> float:
    """A length, to 2 %: so that meshes which are nearly alike share a material."""
    return float(_ALIKE ** round(math.log(span) / math.log(_ALIKE)))


class BumpMaps:
    """The normal maps of a description's heights, each made once."""

    def __init__(self, shelf: TextureShelf, channels: tuple[float, float, float] = (1.0, 0.0, 0.0)) -> None:
        """channels: what red, green and blue of a picture count in its height."""
        self._shelf, self._channels = shelf, np.array(channels, np.float32)
        self._made: dict[tuple[int, int], tuple[int, float] | None] = {}

    def of(self, heights: int, rise: float, spans: tuple[float, float]) -> Bumps | None:
        """The normal map of a texture of heights; None of what is flat.

        rise: how high a value of 1 is, in the unit of spans; spans: as of `spans_of`.
        """
        aspect = min(max(spans[1] / spans[0], 1 / _MOST_ASPECT), _MOST_ASPECT)
        step = round(math.log(aspect) / math.log(_ASPECTS))
        key = heights, step
        if key not in self._made:
            self._made[key] = self._make(heights, step)
        found = self._made[key]
        if found is None:
            return None
        strength = found[1] * rise / spans[0]
        return Bumps(found[0], min(max(strength, -MOST_STRENGTH), MOST_STRENGTH))

    def _make(self, heights: int, step: int) -> tuple[int, float] | None:
        """A texture, and the slope that it counts as 1."""
        texture = self._shelf.texture_of(heights)
        with np.errstate(all="ignore"):
            slopes = _slopes(linear(self._shelf.image_of(heights)) @ self._channels, texture)
            slopes[..., 1] /= np.float32(_ASPECTS**step)
            size = _WITHIN * math.sqrt(float((slopes**2).mean(dtype=np.float64)))
        if not (size > 0 and math.isfinite(size)):
            return None
        what = f"normals of heights {step} {texture.transform} {texture.wrap_s} {texture.wrap_t}"
        made = self._shelf.derived(heights, what, lambda it: _as_normals(it, slopes / np.float32(size)))
        return None if made is None else (made, size)


def _slopes(height: F32, texture: Texture) -> F32:
    """(h, w, 2) by how much heights grow with a mesh's u and v; v downwards."""
    rows, columns = height.shape
    x = columns * _differences(height, 1, texture.wrap_s == "repeat")
    y = rows * _differences(height, 0, texture.wrap_t == "repeat")
    a, b, _, c, d, _ = texture.transform
    return np.stack([a * x + c * y, b * x + d * y], axis=-1).astype(np.float32)


def _differences(height: F32, axis: int, repeats: bool) -> F32:
    """Central differences; at the edges of what does not repeat, to the one side alone."""
    if height.shape[axis] == 1:
        return np.zeros_like(height)
    if repeats:
        return np.asarray((np.roll(height, -1, axis) - np.roll(height, 1, axis)) / 2)
    return np.asarray(np.gradient(height, axis=axis))


def _as_normals(heights: Image, slopes: F32) -> Image:
    """Slopes as glTF's normals: green is up the picture. As precise as the heights are."""
    normals = np.stack([-slopes[..., 0], slopes[..., 1], np.ones(slopes.shape[:2], np.float32)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    values = np.concatenate([0.5 + 0.5 * normals, np.ones_like(normals[..., :1])], axis=-1)
    return Image(f"{heights.name} as normals", encoded(values, heights), srgb=False)
