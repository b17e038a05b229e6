"""Tests of strongly bent vertex normals and normal maps: no energy is lost, for any path depth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from renderer.film import COLOR, mean
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Image, Instance, Material, Mesh, SceneDescription, Texture
from tests.grids import grid
from tests.renderer.builders import gray, icosphere, scene, settings, square
from tests.renderer.judge import assert_mean, mean_and_error


def bevelled_cube(bevel: float = 0.15) -> Mesh:
    """Returns a cube with bevelled edges and corners; each vertex normal is the mean of its facets' normals."""
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
    points = np.concatenate([corners * np.where(np.arange(3) == axis, 1.0, 1.0 - bevel) for axis in range(3)])
    hull = ConvexHull(points)
    normals = np.zeros_like(points)
    triangles = []
    for triangle, plane in zip(hull.simplices, hull.equations, strict=True):
        a, b, c = points[triangle]
        triangles.append(triangle if np.cross(b - a, c - a) @ plane[:3] > 0 else triangle[::-1])
    for plane in np.unique(hull.equations.round(6), axis=0):  # once per square, not per triangle
        normals[abs(points @ plane[:3] + plane[3]) < 1e-6] += plane[:3]
    return Mesh("bevelled", points.astype(np.float32), np.array(triangles, np.int32), normals.astype(np.float32))


def coarse_ball() -> Mesh:
    """Returns a ball of 80 facets with smooth normals."""
    ball = icosphere(1)
    return replace(ball, normals=ball.positions)


def smoothed_box() -> Mesh:
    """Returns a box with shared vertices, whose normals deviate by up to 55 degrees."""
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
    hull = ConvexHull(corners)
    triangles = [t if np.linalg.det(corners[t]) > 0 else t[::-1] for t in hull.simplices]
    return Mesh("smoothed", corners, np.array(triangles, np.int32), corners)


def bumpy_square() -> SceneDescription:
    """Returns a square with a normal map that deviates by up to 60 degrees in all directions."""
    mesh = replace(square((0, 0, 0), (1, 0, 0), (0, 1, 0), 0), uvs=np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32))
    normal = np.random.default_rng(3).normal(size=(8, 8, 3))
    normal[..., 2] = 0.5 + abs(normal[..., 2])
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    codes = np.concatenate([np.round((normal + 1) / 2 * 255), np.full((8, 8, 1), 255)], -1).astype(np.uint8)
    return SceneDescription(
        meshes=[mesh], instances=[Instance(0)], images=[Image("bumps", codes, srgb=False)], textures=[Texture(0)]
    )


METALS = {
    "mirror": Material(kind="mirror", base_color=gray(1.0)),
    "smooth metal": Material(kind="metallic_roughness", base_color=gray(1.0), metallic=1.0, roughness=0.0),
    "metal": Material(kind="metallic_roughness", base_color=gray(1.0), metallic=1.0, roughness=0.3),
    "rough metal": Material(kind="metallic_roughness", base_color=gray(1.0), metallic=1.0, roughness=1.0),
    "plastic": Material(kind="metallic_roughness", base_color=gray(1.0), roughness=0.2),
    "chalk": Material(base_color=gray(1.0)),
}
OTHERS = {
    "coated metal": replace(METALS["metal"], clearcoat=1.0, clearcoat_roughness=0.1),
    "coated plastic": replace(METALS["plastic"], clearcoat=1.0),
    "brushed metal": replace(METALS["metal"], anisotropy=0.7),
    "conductor": Material(kind="conductor", roughness=0.2),
    "smooth conductor": Material(kind="conductor", roughness=0.0),
}
MESHES = (coarse_ball, bevelled_cube, smoothed_box)


def lit(material: Material, of: object):
    """Returns a scene of the object `of` with this material in a white environment, and settings that show all of it."""
    if of is bumpy_square:
        described = bumpy_square()
        described.materials = [replace(material, normal_texture=0)]
        described.environment = Environment(color=gray(1.0))
        return compile_scene(described), settings((1.5, 0.9, 0.6), (0, 0, 0), 50, size=32)
    return scene([material], (of(),), environment=1.0), settings((2.5, 1.4, 4.0), (0, 0, 0), 40, size=32)


@pytest.mark.parametrize("of", [*MESHES, bumpy_square])
@pytest.mark.parametrize("name", METALS)
def test_white_bent_normals_in_a_white_furnace(name, of):
    """White objects with bent normals are invisible in a white environment.

    On a convex object each reflected ray reaches the environment, so two path segments suffice.
    """
    made, asked = lit(METALS[name], of)
    sums = render_frame(made, replace(asked, max_depth=2), 64)
    # Linear interpolation in the albedo tables makes plastic 0.2 % too bright or too dark.
    assert_mean(sums, 1.0, slack=2e-3, tests=len(METALS) * (1 + len(MESHES)))
    if name in ("mirror", "smooth metal"):
        assert mean(sums, 24).min() > 0.97
        assert mean(sums, 24).max() < 1.03


@grid("of", [*MESHES, bumpy_square])
@grid("name", [*METALS, *OTHERS], ordinary=("metal", "plastic", "smooth conductor"))
def test_repeated_hits_of_one_facet_are_not_counted(name, of):
    """Repeated hits of one facet do not count as bounces: a convex object looks identical for any maximum depth."""
    made, asked = lit({**METALS, **OTHERS}[name], of)
    shallow, deep = (render_frame(made, replace(asked, max_depth=depth), 4) for depth in (2, 64))
    np.testing.assert_array_equal(shallow[COLOR], deep[COLOR])


@pytest.mark.parametrize("of", MESHES)
@pytest.mark.parametrize(("roughness", "least"), [(0.0, 0.92), (0.5, 0.99)])
def test_glass_with_bent_normals_conserves_energy(roughness, least, of):
    """Refraction with bent normals is not reversible: smooth glass may trap some light but never gains any."""
    made, asked = lit(Material(kind="glass", base_color=gray(1.0), roughness=roughness), of)
    found, error = mean_and_error(render_frame(made, replace(asked, max_depth=400), 64))
    assert least < found < 1.0 + 4 * error + 2e-3


@pytest.mark.parametrize("integrator", ["path", pytest.param("whitted", marks=pytest.mark.long)])
def test_low_poly_mirror_has_no_black_rim(integrator):
    made, asked = lit(METALS["mirror"], coarse_ball)
    sums = render_frame(made, replace(asked, integrator=integrator, max_depth=4), 16)
    np.testing.assert_allclose(mean(sums, 24), 1.0, atol=1e-5)
