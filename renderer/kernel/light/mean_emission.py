"""Mean emission of textured triangles, which determines the probability of choosing each triangle as a light."""

from __future__ import annotations

import numpy as np

from renderer.jit import builder
from renderer.kernel.material.texture import lookup
from renderer.kernel.sampling.warp import square_to_triangle

__all__ = ["mean_texels"]

_STEPS = 8  # per axis: 64 points a triangle


@builder
def mean_texels(texture, transform, texel, number, uv, uv1, triangle, mean):
    """Adds to mean (n, 3) the linear RGB of texture `number` averaged over each triangle.

    triangle: (n, 3), indices into the texture coordinates uv and uv1, (V, 2) each.
    """
    step = np.float32(1.0 / _STEPS)
    share = step * step
    half = np.float32(0.5)
    for i in range(len(triangle)):
        a, b, c = triangle[i, 0], triangle[i, 1], triangle[i, 2]
        for row in range(_STEPS):
            for column in range(_STEPS):
                s, t = square_to_triangle(((np.float32(row) + half) * step, (np.float32(column) + half) * step))
                r = np.float32(1.0) - s - t
                first = r * uv[a, 0] + s * uv[b, 0] + t * uv[c, 0], r * uv[a, 1] + s * uv[b, 1] + t * uv[c, 1]
                second = r * uv1[a, 0] + s * uv1[b, 0] + t * uv1[c, 0], r * uv1[a, 1] + s * uv1[b, 1] + t * uv1[c, 1]
                red, green, blue, _ = lookup(texture, transform, texel, number, first, second, None, None)
                mean[i, 0] += red * share
                mean[i, 1] += green * share
                mean[i, 2] += blue * share
