"""Bakes procedural textures over the unit square of UVs, v measured from the top."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.scene.description import Texture, UvTransform

__all__ = ["SIZE", "Grid", "checks", "grid", "looked_up"]

SIZE = 1024
F64 = npt.NDArray[np.float64]


class Grid(NamedTuple):
    """The UVs of an image's pixel centres, as (rows, columns) arrays of u and of v."""

    u: F64
    v: F64

    def transformed_uvs(self, transform: UvTransform) -> tuple[F64, F64]:
        """Returns the grid's u and v after a texture transform.

        Without rotation or shear, u is a single row and v a single column, to be broadcast.
        """
        a, b, c, d, e, f = transform
        if b == d == 0:
            return a * self.u[:1] + c, e * self.v[:, :1] + f
        return a * self.u + b * self.v + c, d * self.u + e * self.v + f


def grid(size: tuple[int, int] = (SIZE, SIZE), first: int = 0, rows: int | None = None) -> Grid:
    """Returns the UVs of the pixel centres of an image, or of some of its rows.

    size: (columns, rows) of the image; first: index of the first row; rows: number of rows, by default all from `first` on.
    """
    columns, height = size
    at = np.arange(first, height if rows is None else first + rows)
    u, v = np.meshgrid((np.arange(columns) + 0.5) / columns, (at + 0.5) / height)
    return Grid(u, v)


def checks(grid_points: Grid, transform: UvTransform) -> npt.NDArray[np.bool_]:
    """Returns a (rows, columns, 1) checkerboard mask: True on the squares that show the first of the two textures."""
    u, v = grid_points.transformed_uvs(transform)
    odd = (np.floor(u) + np.floor(1 - v)) % 2 != 0
    return np.asarray(~odd[..., None])


def looked_up(texture: Texture, pixels: npt.NDArray[np.float32], grid_points: Grid) -> F64:
    """Returns (rows, columns, channels) values of a texture at the grid's UVs, with the texture's filter and wrap modes.

    pixels: (h, w, channels) of the texture's image.
    """
    u, v = grid_points.transformed_uvs(texture.transform)
    height, width = pixels.shape[:2]
    x, y = (_wrap_coordinates(each, wrap) for each, wrap in ((u, texture.wrap_s), (v, texture.wrap_t)))
    if texture.filter == "nearest":
        return pixels[np.clip((y * height).astype(int), 0, height - 1), np.clip((x * width).astype(int), 0, width - 1)].astype(
            float
        )
    x, y = x * width - 0.5, y * height - 0.5
    left, above = np.floor(x).astype(int), np.floor(y).astype(int)
    across, down = (x - left)[..., None], (y - above)[..., None]
    columns = [_index(left + k, width, texture.wrap_s) for k in (0, 1)]
    rows = [_index(above + k, height, texture.wrap_t) for k in (0, 1)]
    upper, lower = (pixels[r, columns[0]] * (1 - across) + pixels[r, columns[1]] * across for r in rows)
    return np.asarray(upper * (1 - down) + lower * down, float)


def _wrap_coordinates(values: F64, wrap: str) -> F64:
    return np.asarray(values - np.floor(values) if wrap == "repeat" else np.clip(values, 0, 1))


def _index(index: npt.NDArray[np.int64], size: int, wrap: str) -> npt.NDArray[np.int64]:
    return index % size if wrap == "repeat" else np.clip(index, 0, size - 1)
