"""Makes the tables of directional albedo that the microfacet models are energy-compensated by: .npy files beside this one.

`python -m renderer.kernel.bsdf.albedo_tables` writes them again; a test compares them with what this makes. They are kept
as files because every host must render by the same bits, and numpy's sines differ in theirs from host to host.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

__all__ = [
    "CHARLIE_LAMBDA",
    "GLASS_SIZE",
    "MOST_BEND",
    "SIZE",
    "ggx_albedo",
    "ggx_table",
    "glass_albedo",
    "glass_table",
    "main",
    "mean_over_hemisphere",
    "sheen_albedo",
    "sheen_table",
    "table_path",
]

F64 = npt.NDArray[np.float64]
SIZE = 32  # nodes of roughness (sqrt alpha) and of the square root of the cosine, both even from 0 to 1
_SMALLEST = 1e-4
GLASS_SIZE = 16  # nodes likewise, and of (eta - 1) / (eta + 1), even from -MOST_BEND to MOST_BEND
MOST_BEND = 0.45  # eta from 0.38 to 2.64
# a, b, c, d, e of log Lambda, for alpha 0 and alpha 1 (Estevez & Kulla, "Production Friendly Microfacet Sheen BRDF", 2017).
CHARLIE_LAMBDA = (25.3245, 3.32435, 0.16801, -1.27393, -4.85967), (21.5473, 3.82987, 0.19823, -1.97760, -4.32054)


def ggx_albedo(cosine: float, alpha: float, steps: int = 192) -> tuple[float, float]:
    """(A, B): a GGX mirror whose microfacets reflect by Schlick scatters F0 A + F90 B of the light from this direction, once.

    The mean of G2 / G1 times Schlick's two parts over visible normals, by midpoints in the square that those are sampled from.
    """
    wo = np.array([np.sqrt(1 - cosine**2), 0.0, cosine])
    h = _visible_normals(wo, alpha, steps)
    cosine_h = np.clip(h @ wo, 0, 1)
    wi_z = 2 * cosine_h * h[..., 2] - cosine
    up = wi_z > 1e-9
    lambda_o = _smith_lambda(cosine, alpha)
    lambda_i = _smith_lambda(np.where(up, wi_z, 1.0), alpha)
    shadowing = np.where(up, (1 + lambda_o) / (1 + lambda_o + lambda_i), 0.0)
    schlick = (1 - cosine_h) ** 5
    return float((shadowing * (1 - schlick)).mean()), float((shadowing * schlick).mean())


def _visible_normals(wo: F64, alpha: float, steps: int) -> F64:
    """(steps, steps / 2, 3) microfacet normals by the area that wo sees of them, on the half of the circle where y > 0."""
    u, v = np.meshgrid((np.arange(steps) + 0.5) / steps, (np.arange(steps // 2) + 0.5) / steps, indexing="ij")
    stretched = wo * (alpha, alpha, 1)
    stretched /= np.linalg.norm(stretched)
    z = (1 - u) * (1 + stretched[2]) - stretched[2]
    radius = np.sqrt(np.clip(1 - z * z, 0, 1))
    x = radius * np.cos(2 * np.pi * v) + stretched[0]
    y = radius * np.sin(2 * np.pi * v)
    h = np.stack([x * alpha, y * alpha, z + stretched[2]], -1)
    return np.asarray(h / np.linalg.norm(h, axis=-1, keepdims=True))


def _smith_lambda(cosine: float | F64, alpha: float) -> F64:
    return (np.sqrt(1 + alpha**2 * (1 / np.square(cosine) - 1)) - 1) / 2


def glass_albedo(cosine: float, alpha: float, eta: float, steps: int = 128) -> float:
    """What a rough boundary reflects and transmits of light from this direction, once. eta: index beyond over index here."""
    wo = np.array([np.sqrt(1 - cosine**2), 0.0, cosine])
    h = _visible_normals(wo, alpha, steps)
    cosine_h = np.clip(h @ wo, 0, 1)
    inside2 = 1 - (1 - cosine_h**2) / eta**2
    inside = np.sqrt(np.clip(inside2, 0, None))
    s = (cosine_h - eta * inside) / (cosine_h + eta * inside)
    p = (eta * cosine_h - inside) / (eta * cosine_h + inside)
    reflectance = np.where(inside2 > 0, (s * s + p * p) / 2, 1.0)
    lambda_o = _smith_lambda(cosine, alpha)
    total = np.zeros_like(cosine_h)
    up = 2 * cosine_h * h[..., 2] - cosine
    down = cosine / eta - (cosine_h / eta - inside) * h[..., 2]
    for share, z in ((reflectance, up), (1 - reflectance, down)):
        lambda_i = _smith_lambda(np.where(z > 1e-9, z, 1.0), alpha)
        total += np.where(z > 1e-9, share * (1 + lambda_o) / (1 + lambda_o + lambda_i), 0.0)
    return float(total.mean())


def glass_table() -> F64:
    """(GLASS_SIZE, GLASS_SIZE + 1, GLASS_SIZE): by bend, roughness, cosine; the middle axis' last row holds the means."""
    node = np.arange(GLASS_SIZE) / (GLASS_SIZE - 1)
    bend = (2 * node - 1) * MOST_BEND
    table = np.array(
        [
            [[glass_albedo(max(t * t, _SMALLEST), max(r * r, _SMALLEST), (1 + b) / (1 - b)) for t in node] for r in node]
            for b in bend
        ]
    )
    mean = np.array([[mean_over_hemisphere(row) for row in plane] for plane in table])
    return np.concatenate([table, mean[:, None]], axis=1)


def sheen_albedo(cosine: float, alpha: float, steps: int = 256) -> float:
    """What a white Charlie sheen scatters of the light from this direction, by midpoints over the other directions."""
    z, turn = np.meshgrid((np.arange(steps) + 0.5) / steps, (np.arange(steps) + 0.5) / steps * np.pi, indexing="ij")
    r = np.sqrt(1 - z * z)
    h = np.stack([r * np.cos(turn) + np.sqrt(1 - cosine**2), r * np.sin(turn), z + cosine], -1)
    sine2 = 1 - h[..., 2] ** 2 / (h**2).sum(-1)
    density = (2 + 1 / alpha) * sine2 ** (0.5 / alpha) / (2 * np.pi)
    shadowing = 1 + _charlie_lambda(cosine, alpha) + _charlie_lambda(z, alpha)
    return float((density / (shadowing * 4 * cosine)).mean() * 2 * np.pi)


def _charlie_lambda(cosine: float | F64, alpha: float) -> F64:
    smooth, rough = (np.array(c) for c in CHARLIE_LAMBDA)
    a, b, c, d, e = rough + (smooth - rough) * (1 - alpha) ** 2

    def fit(x: float | F64) -> F64:
        return np.asarray(a / (1 + b * x**c) + d * x + e)

    steep = np.asarray(cosine, np.float64)
    return np.where(steep < 0.5, np.exp(fit(np.minimum(steep, 0.5))), np.exp(2 * fit(0.5) - fit(np.minimum(1 - steep, 0.5))))


def sheen_table() -> F64:
    """(SIZE + 1, SIZE), as `ggx_table`; the last row holds the means."""
    node = np.arange(SIZE) / (SIZE - 1)
    table = np.array([[sheen_albedo(max(t * t, _SMALLEST), max(r * r, _SMALLEST)) for t in node] for r in node])
    return np.concatenate([table, [[mean_over_hemisphere(row) for row in table]]])


def ggx_table() -> F64:
    """(SIZE + 1, SIZE, 2): [i, j] is (A, B) at roughness i / (SIZE - 1) and cosine (j / (SIZE - 1))**2.

    The last row of the first axis is not a roughness: it holds the means over the hemisphere, by roughness.
    """
    node = np.arange(SIZE) / (SIZE - 1)
    table = np.array([[ggx_albedo(max(t * t, _SMALLEST), max(r * r, _SMALLEST)) for t in node] for r in node])
    mean = np.array([[mean_over_hemisphere(row[:, k]) for k in range(2)] for row in table])
    return np.concatenate([table, mean[None]])


def mean_over_hemisphere(values: F64) -> float:
    """The cosine-weighted mean of a function that is linear between its values at even nodes of sqrt(cosine)."""
    steps = 16 * (len(values) - 1)
    t = (np.arange(steps) + 0.5) / steps
    # cosine = t**2, and 2 cosine d cosine = 4 t**3 dt
    return float((np.interp(t, np.linspace(0, 1, len(values)), values) * 4 * t**3).sum() / (4 * t**3).sum())


def table_path(name: str) -> Path:
    """Where the table of that name is kept."""
    return Path(__file__).with_name(f"{name}.npy")


def main() -> None:
    """Writes the tables."""
    np.save(table_path("ggx_albedo"), ggx_table().astype(np.float32))
    np.save(table_path("glass_albedo"), glass_table().astype(np.float32))
    np.save(table_path("sheen_albedo"), sheen_table().astype(np.float32))


if __name__ == "__main__":
    main()
