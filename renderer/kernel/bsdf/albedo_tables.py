"""Generates the directional albedo tables for the energy compensation of microfacet models: .npy files in this folder.

`python -m renderer.kernel.bsdf.albedo_tables` writes the files; a test compares them with this generator. The tables are stored
because all hosts must render the same bits, and numpy's trigonometric functions differ between hosts.
"""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import numpy.typing as npt

__all__ = [
    "BRUSHED_NODES",
    "CHARLIE_LAMBDA",
    "COAT_NODES",
    "GLASS_SIZE",
    "MOST_BEND",
    "SIZE",
    "brushed_albedo",
    "brushed_means",
    "brushed_node",
    "brushed_table",
    "coat_table",
    "facets_pass",
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
# Nodes of the root of the greater alpha, of the root of the lesser over the greater, of the root of the cosine, and of where the
# alpha of the azimuth lies between the two; all even from 0 to 1.
BRUSHED_NODES = (16, 8, 16, 6)
COAT_NODES = (12, 16, 32)  # of (eta - 1) / (eta + 1), even from 0 to MOST_BEND; of roughness and root of the cosine likewise
MOST_BEND = 0.45  # eta from 0.38 to 2.64
# a, b, c, d, e of log Lambda, for alpha 0 and alpha 1 (Estevez & Kulla, "Production Friendly Microfacet Sheen BRDF", 2017).
CHARLIE_LAMBDA = (25.3245, 3.32435, 0.16801, -1.27393, -4.85967), (21.5473, 3.82987, 0.19823, -1.97760, -4.32054)


def ggx_albedo(cosine: float, alpha: float, steps: int = 192) -> tuple[float, float]:
    """Returns (A, B), such that F0 A + F90 B is the single-scattering albedo of GGX with Schlick's Fresnel for this direction.

    A and B are means over visible normals of G2 / G1 times Schlick's two terms, by midpoints in the square from which normals are
    sampled.
    """
    wo = np.array([np.sqrt(1 - cosine**2), 0.0, cosine])
    h = _visible_normals(wo, alpha, alpha, steps, steps // 2)
    cosine_h = np.clip(h @ wo, 0, 1)
    wi_z = 2 * cosine_h * h[..., 2] - cosine
    up = wi_z > 1e-9
    lambda_o = _smith_lambda(cosine, alpha)
    lambda_i = _smith_lambda(np.where(up, wi_z, 1.0), alpha)
    shadowing = np.where(up, (1 + lambda_o) / (1 + lambda_o + lambda_i), 0.0)
    schlick = (1 - cosine_h) ** 5
    return float((shadowing * (1 - schlick)).mean()), float((shadowing * schlick).mean())


def _visible_normals(wo: F64, alpha_x: float, alpha_y: float, steps: int, turns: int, distribution: str = "ggx") -> F64:
    """Returns microfacet normals, (steps, turns, 3), distributed as visible from direction wo.

    turns: number of azimuths; steps / 2 of them cover the half circle y > 0.
    """
    if distribution == "beckmann":
        return _visible_beckmann(wo, alpha_x, alpha_y, steps, turns)
    u, v = np.meshgrid((np.arange(steps) + 0.5) / steps, (np.arange(turns) + 0.5) / steps, indexing="ij")
    stretched = wo * (alpha_x, alpha_y, 1)
    stretched /= np.linalg.norm(stretched)
    z = (1 - u) * (1 + stretched[2]) - stretched[2]
    radius = np.sqrt(np.clip(1 - z * z, 0, 1))
    x = radius * np.cos(2 * np.pi * v) + stretched[0]
    y = radius * np.sin(2 * np.pi * v) + stretched[1]
    h = np.stack([x * alpha_x, y * alpha_y, z + stretched[2]], -1)
    return np.asarray(h / np.linalg.norm(h, axis=-1, keepdims=True))


def _visible_beckmann(wo: F64, alpha_x: float, alpha_y: float, steps: int, turns: int) -> F64:
    """Returns microfacet normals, (steps, turns, 3), distributed as visible from direction wo under Beckmann's distribution.

    Slopes along wo's azimuth are computed by the tabulated inverse of their distribution; slopes across it are Gaussian.
    """
    x, y = wo[0] * alpha_x, wo[1] * alpha_y
    sine = float(np.hypot(x, y))
    cosine, turn = (x / sine, y / sine) if sine > 0 else (1.0, 0.0)
    tangent = sine / wo[2]
    least = max(-5.0, -1 / tangent) if tangent > 0 else -5.0
    slope = np.linspace(least, 5.0, 4097)
    middle = 0.5 * (slope[1:] + slope[:-1])

    def quantiles(density: F64, count: int) -> F64:
        summed = np.concatenate([[0.0], np.cumsum(density)])
        return np.interp((np.arange(count) + 0.5) / count * summed[-1], summed, slope)

    along = quantiles((1 + middle * tangent) * np.exp(-(middle**2)), steps)
    slope = np.linspace(-5.0, 5.0, 4097)
    across = quantiles(np.exp(-((0.5 * (slope[1:] + slope[:-1])) ** 2)), turns)
    along, across = np.meshgrid(along, across, indexing="ij")
    h = np.stack(
        [(cosine * along - turn * across) * alpha_x, (turn * along + cosine * across) * alpha_y, np.ones_like(along)], -1
    )
    return np.asarray(h / np.linalg.norm(h, axis=-1, keepdims=True))


def _lambda(tangent: float | F64, distribution: str) -> F64:
    """Returns Smith's Lambda. tangent: alpha times the tangent of the angle between direction and normal."""
    tangent = np.asarray(tangent, np.float64)
    if distribution == "ggx":
        return np.asarray((np.sqrt(1 + tangent**2) - 1) / 2)
    a = 1 / np.maximum(tangent, 0.2)
    t = 1 / (1 + 0.3275911 * a)  # Abramowitz & Stegun 7.1.26, as in renderer/kernel/polynomial.py
    tail = t * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + t * (-1.453152027 + t * 1.061405429)))) * np.exp(-a * a)
    return np.where(tangent > 0.25, np.maximum(np.exp(-a * a) / (2 * a * np.sqrt(np.pi)) - tail / 2, 0), 0.0)


def _smith_lambda(cosine: float | F64, alpha: float, distribution: str = "ggx") -> F64:
    if distribution != "ggx":
        return _lambda(alpha * np.sqrt(np.maximum(1 - np.square(cosine), 0)) / cosine, distribution)
    return (np.sqrt(1 + alpha**2 * (1 / np.square(cosine) - 1)) - 1) / 2


def brushed_albedo(wo: F64, alpha_x: float, alpha_y: float, steps: int = 64, distribution: str = "ggx") -> tuple[float, float]:
    """Returns (A, B), see `ggx_albedo`, of anisotropic microfacets with two alphas for light from direction wo."""
    h = _visible_normals(wo, alpha_x, alpha_y, steps, steps, distribution)
    cosine_h = np.clip(h @ wo, 0, 1)
    wi = 2 * cosine_h[..., None] * h - wo
    up = wi[..., 2] > 1e-9

    def smith_lambda(w: F64) -> F64:
        slope2 = ((alpha_x * w[..., 0]) ** 2 + (alpha_y * w[..., 1]) ** 2) / np.maximum(w[..., 2], 1e-9) ** 2
        if distribution != "ggx":
            return _lambda(np.sqrt(slope2), distribution)
        return np.asarray((np.sqrt(1 + slope2) - 1) / 2)

    lambda_o = smith_lambda(wo)
    shadowing = np.where(up, (1 + lambda_o) / (1 + lambda_o + smith_lambda(wi)), 0.0)
    schlick = (1 - cosine_h) ** 5
    return float((shadowing * (1 - schlick)).mean()), float((shadowing * schlick).mean())


def brushed_node(i: int, j: int, k: int, n: int, distribution: str = "ggx") -> tuple[float, float]:
    """Returns the albedo terms (A, B) for one node of `brushed_table`, with indices i, j and k and n midpoints."""
    r, q, t, a = (index / (nodes - 1) for index, nodes in zip((i, j, k, n), BRUSHED_NODES, strict=True))
    alpha_x = max(r * r, _SMALLEST)
    alpha_y = alpha_x * max(q * q, 1e-2 * _SMALLEST)
    cosine = max(t * t, _SMALLEST)
    squares = alpha_x**2 - alpha_y**2
    along = ((alpha_y + a * (alpha_x - alpha_y)) ** 2 - alpha_y**2) / squares if squares > 0 else 0.5
    along = min(max(along, 0.0), 1.0)  # the square of the azimuth's cosine
    sine = np.sqrt(1 - cosine**2)
    wo = np.array([sine * np.sqrt(along), sine * np.sqrt(1 - along), cosine])
    return brushed_albedo(wo, alpha_x, alpha_y, distribution=distribution)


def brushed_means(plane: F64, j: int) -> list[float]:
    """Returns the means of the albedo terms (A, B) over the hemisphere.

    plane: (cosines, azimuths, 2), at node j of the ratio of alphas.
    """
    least = (j / (BRUSHED_NODES[1] - 1)) ** 2  # the lesser alpha over the greater
    turn = (np.arange(256) + 0.5) / 256 * np.pi / 2
    alpha = np.sqrt(np.cos(turn) ** 2 + (least * np.sin(turn)) ** 2)
    at = (alpha - least) / (1 - least) if least < 1 else np.zeros_like(alpha)
    node = np.linspace(0, 1, plane.shape[1])
    return [mean_over_hemisphere(np.array([np.interp(at, node, row).mean() for row in plane[..., k]])) for k in range(2)]


def brushed_table(distribution: str = "ggx") -> F64:
    """Returns the table of the albedo terms (A, B), see `ggx_albedo`, at BRUSHED_NODES.

    The third axis has one more row, with the means over the hemisphere.
    """
    table = np.array([brushed_node(i, j, k, n, distribution) for i, j, k, n in np.ndindex(BRUSHED_NODES)]).reshape(
        *BRUSHED_NODES, 2
    )
    means = np.array([[brushed_means(plane, j) for j, plane in enumerate(of_ratio)] for of_ratio in table])
    return np.concatenate([table, np.repeat(means[:, :, None, None], BRUSHED_NODES[3], axis=3)], axis=2)


def glass_albedo(cosine: float, alpha: float, eta: float, steps: int = 128, distribution: str = "ggx") -> float:
    """Returns the single-scattering albedo of a rough dielectric boundary for one direction: reflection plus transmission.

    eta: index beyond the boundary over index on this side.
    """
    wo = np.array([np.sqrt(1 - cosine**2), 0.0, cosine])
    h = _visible_normals(wo, alpha, alpha, steps, steps // 2, distribution)
    cosine_h = np.clip(h @ wo, 0, 1)
    inside2 = 1 - (1 - cosine_h**2) / eta**2
    inside = np.sqrt(np.clip(inside2, 0, None))
    s = (cosine_h - eta * inside) / (cosine_h + eta * inside)
    p = (eta * cosine_h - inside) / (eta * cosine_h + inside)
    reflectance = np.where(inside2 > 0, (s * s + p * p) / 2, 1.0)
    lambda_o = _smith_lambda(cosine, alpha, distribution)
    total = np.zeros_like(cosine_h)
    up = 2 * cosine_h * h[..., 2] - cosine
    down = cosine / eta - (cosine_h / eta - inside) * h[..., 2]
    for share, z in ((reflectance, up), (1 - reflectance, down)):
        lambda_i = _smith_lambda(np.where(z > 1e-9, z, 1.0), alpha, distribution)
        total += np.where(z > 1e-9, share * (1 + lambda_o) / (1 + lambda_o + lambda_i), 0.0)
    return float(total.mean())


def glass_table(distribution: str = "ggx") -> F64:
    """Returns the table (GLASS_SIZE, GLASS_SIZE + 1, GLASS_SIZE) of `glass_albedo`, by index of refraction, roughness and cosine.

    The last row of the middle axis contains the means over the hemisphere.
    """
    node = np.arange(GLASS_SIZE) / (GLASS_SIZE - 1)
    bend = (2 * node - 1) * MOST_BEND
    table = np.array(
        [
            [
                [
                    glass_albedo(max(t * t, _SMALLEST), max(r * r, _SMALLEST), (1 + b) / (1 - b), distribution=distribution)
                    for t in node
                ]
                for r in node
            ]
            for b in bend
        ]
    )
    mean = np.array([[mean_over_hemisphere(row) for row in plane] for plane in table])
    return np.concatenate([table, mean[:, None]], axis=1)


def facets_pass(cosine: float, eta: float, alpha: float, distribution: str = "ggx", steps: int = 96) -> tuple[float, float]:
    """Returns (reflected, transmitted): the fractions of light from one direction after single scattering; the rest is lost.

    Shadowing is G1(wo) G1(wi). eta: index beyond the boundary over index on this side.
    """
    wo = np.array([np.sqrt(1 - cosine**2), 0.0, cosine])
    h = _visible_normals(wo, alpha, alpha, steps, steps // 2, distribution)
    cosine_h = np.clip(h @ wo, 0, 1)
    inside2 = 1 - (1 - cosine_h**2) / eta**2
    inside = np.sqrt(np.clip(inside2, 0, None))
    s = (cosine_h - eta * inside) / (cosine_h + eta * inside)
    p = (eta * cosine_h - inside) / (eta * cosine_h + inside)
    reflectance = np.where(inside2 > 0, (s * s + p * p) / 2, 1.0)
    up = 2 * cosine_h * h[..., 2] - cosine
    down = cosine / eta - (cosine_h / eta - inside) * h[..., 2]

    def seen(share: F64, z: F64) -> float:
        lambda_i = _smith_lambda(np.where(z > 1e-9, z, 1.0), alpha, distribution)
        return float(np.where(z > 1e-9, share / (1 + lambda_i), 0.0).mean())

    return seen(reflectance, up), seen(1 - reflectance, down)


def coat_table(distribution: str = "ggx") -> F64:
    """Returns the coat table: the fraction of light from outside that a rough coat's facets transmit, at COAT_NODES.

    The last axis has one more entry: the fraction of diffuse light from inside that the facets reflect back.
    """
    bends, roughnesses, cosines = (np.linspace(0, 1, nodes) for nodes in COAT_NODES)
    found = np.empty((len(bends), len(roughnesses), len(cosines) + 1))
    for (k, b), (i, r) in itertools.product(enumerate(bends * MOST_BEND), enumerate(roughnesses)):
        eta, alpha = (1 + b) / (1 - b), max(r * r, 1e-3)
        heights = np.maximum(np.square(cosines), _SMALLEST)
        found[k, i, :-1] = [facets_pass(c, eta, alpha, distribution)[1] for c in heights.tolist()]
        found[k, i, -1] = mean_over_hemisphere(
            np.array([facets_pass(c, 1 / eta, alpha, distribution)[0] for c in heights.tolist()])
        )
    return found


def sheen_albedo(cosine: float, alpha: float, steps: int = 256) -> float:
    """Returns the albedo of white Charlie sheen for one direction, by midpoints over the outgoing directions."""
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
    """Returns the table (SIZE + 1, SIZE) of the sheen albedo, by roughness and cosine as in `ggx_table`.

    The last row contains the means over the hemisphere.
    """
    node = np.arange(SIZE) / (SIZE - 1)
    table = np.array([[sheen_albedo(max(t * t, _SMALLEST), max(r * r, _SMALLEST)) for t in node] for r in node])
    return np.concatenate([table, [[mean_over_hemisphere(row) for row in table]]])


def ggx_table() -> F64:
    """Returns the table (SIZE + 1, SIZE, 2) of `ggx_albedo`.

    [i, j] is (A, B) at roughness i / (SIZE - 1) and cosine (j / (SIZE - 1))**2. The last row of the first axis contains the
    means over the hemisphere, by roughness.
    """
    node = np.arange(SIZE) / (SIZE - 1)
    table = np.array([[ggx_albedo(max(t * t, _SMALLEST), max(r * r, _SMALLEST)) for t in node] for r in node])
    mean = np.array([[mean_over_hemisphere(row[:, k]) for k in range(2)] for row in table])
    return np.concatenate([table, mean[None]])


def mean_over_hemisphere(values: F64) -> float:
    """Returns the cosine-weighted mean of a function that is linear between values at even nodes of sqrt(cosine)."""
    steps = 16 * (len(values) - 1)
    t = (np.arange(steps) + 0.5) / steps
    # cosine = t**2, and 2 cosine d cosine = 4 t**3 dt
    return float((np.interp(t, np.linspace(0, 1, len(values)), values) * 4 * t**3).sum() / (4 * t**3).sum())


def table_path(name: str) -> Path:
    """Returns the path of the table file of that name."""
    return Path(__file__).with_name(f"{name}.npy")


def main() -> None:
    """Writes all tables to their files."""
    np.save(table_path("ggx_albedo"), ggx_table().astype(np.float32))
    np.save(table_path("brushed_albedo"), brushed_table().astype(np.float32))
    np.save(table_path("glass_albedo"), glass_table().astype(np.float32))
    for distribution in ("ggx", "beckmann"):
        np.save(table_path(f"{distribution}_coat"), coat_table(distribution).astype(np.float32))
    np.save(table_path("beckmann_albedo"), brushed_table("beckmann").astype(np.float32))
    np.save(table_path("beckmann_glass_albedo"), glass_table("beckmann").astype(np.float32))
    np.save(table_path("sheen_albedo"), sheen_table().astype(np.float32))


if __name__ == "__main__":
    main()
