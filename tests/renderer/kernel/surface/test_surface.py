"""Tests of surface interaction: the same in world and instance space, at any scale, and never across the surface."""

import numpy as np
import pytest

from renderer.bvh.traverse import NO_PRIMITIVE, closest_hit, new_stack
from renderer.jit import entry, subroutine
from renderer.kernel import vec
from renderer.kernel.surface.ray_origins import offset_ray_origin
from renderer.kernel.surface.surface import surface_at
from renderer.reference import Packed, by_reference
from renderer.scene.compile import compile_scene
from renderer.scene.description import Instance, Material, Mesh, SceneDescription, Sphere, Texture
from tests.grids import grid
from tests.renderer.builders import as_rendered, box, icosphere, scene
from tests.renderer.kernel.subject import many
from tests.renderer.kernel.wander import touch, wander

WIDTHS = {"point": 3, "geometric": 3, "shading": 3, "uv": 2, "uv1": 2, "color": 4, "tangent": 4, "shadow_point": 3, "start": 3}


@subroutine
def _write_surface(made, stack, o, d, point, geometric, shading, uv, uv1, color, tangent, shadow_point, start, number):
    for i in range(len(o)):
        origin, direction = (o[i, 0], o[i, 1], o[i, 2]), (d[i, 0], d[i, 1], d[i, 2])
        hit = closest_hit(made.bvh, stack, origin, direction, np.float32(np.inf), None)
        number[i, 0] = -1
        if hit.primitive == NO_PRIMITIVE:
            continue
        surface = surface_at(made, origin, direction, hit)
        first = offset_ray_origin(surface, True, vec.neg(direction))
        for k in range(3):
            point[i, k] = surface.point[k]
            geometric[i, k] = surface.geometric[k]
            shading[i, k] = surface.shading[k]
            shadow_point[i, k] = surface.point[k] + surface.lift[k]
            start[i, k] = first[k]
        for k in range(2):
            uv[i, k] = surface.uv[k]
            uv1[i, k] = surface.uv1[k]
        for k in range(4):
            color[i, k] = surface.color[k]
            tangent[i, k] = surface.tangent[k]
        number[i, 0] = surface.object
        number[i, 1] = surface.material
        number[i, 2] = surface.light
        number[i, 3] = surface.front


@entry
def _look(made, stack, o, d, point, geometric, shading, uv, uv1, color, tangent, shadow_point, start, number):
    _write_surface(
        by_reference(made), stack, o, d, point, geometric, shading, uv, uv1, color, tangent, shadow_point, start, number
    )


def look(made, o, d):
    """Returns the surfaces that rays hit, by field; "number" holds object (-1 for a miss), material, light and front."""
    d = np.ascontiguousarray(d, np.float32)
    o = many(o, len(d))
    found = {name: np.zeros((len(d), width), np.float32) for name, width in WIDTHS.items()}
    found["number"] = np.zeros((len(d), 4), np.int64)
    _look(Packed(as_rendered(made)), new_stack(), o, d, *found.values())
    return found


def directions(rng, n):
    d = rng.standard_normal((n, 3))
    return (d / np.linalg.norm(d, axis=1, keepdims=True)).astype(np.float32)


def turned(rng, scale=1.0, mirror=False, at=(0, 0, 0)):
    matrix = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    if (np.linalg.det(matrix) < 0) != mirror:
        matrix[0] *= -1
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = matrix * scale, at
    return transform


@pytest.fixture(params=["copied", "kept once"])
def sharing(request, monkeypatch):
    """Runs the test twice, with instances copied to world space and with instances kept; returns the name of the current way."""
    keep_as(request.param, monkeypatch)
    return request.param


def keep_as(which, monkeypatch):
    monkeypatch.setattr("renderer.scene.instances._MIN_TREE_TRIANGLES", 0 if which == "kept once" else 10**9)
    monkeypatch.setattr("renderer.scene.instances._MIN_SAVED_TRIANGLES", 0)


def painted(levels=2):
    """Returns a smooth ball with all vertex attributes."""
    mesh = icosphere(levels)
    rng = np.random.default_rng(0)
    n = len(mesh.positions)
    uvs, uvs1 = (
        mesh.positions[:, :2] / (1.02 - mesh.positions[:, 2:]),
        mesh.positions[:, 1:] * 0.3,
    )  # stereographic, so not mirrored
    return Mesh("ball", mesh.positions, mesh.triangles, mesh.positions, uvs, 0, uvs1, rng.random((n, 4), np.float32))


def description_of(mesh, places, materials=None, **more):
    """Returns a scene of instances of a mesh with normal maps, which need tangents."""
    materials = materials or [Material(normal_texture=0, base_color_texture=0), Material(roughness=0.3)]
    images = [image()]
    return SceneDescription(
        meshes=[mesh],
        instances=[Instance(0, place, name=f"copy {i}") for i, place in enumerate(places)],
        materials=materials,
        textures=[Texture(0), Texture(0, uv_set=1)],
        images=images,
        **more,
    )


def image():
    from renderer.scene.description import Image

    return Image("white", np.full((2, 2, 4), 255, np.uint8))


@pytest.mark.long
def test_instance_surface_equals_its_copy(monkeypatch):
    """Position, normals, tangents, colours and ids equal the copy's for any transform, seen from outside and inside."""
    rng = np.random.default_rng(1)
    places = [turned(rng, s, m, at) for s, m, at in ((0.5, False, (1, 0, 0)), (1.2, True, (-2, 1, 0)), (0.8, True, (0, -3, 1)))]
    description = description_of(painted(), places)
    description.instances[1].material = 1
    description.materials[1].base_color_texture = 1
    made = []
    for which in ("copied", "kept once"):
        keep_as(which, monkeypatch)
        made.append(compile_scene(description))
    assert len(made[0].to_world) == 0
    assert len(made[1].to_world) == 3
    assert len(made[1].triangle) * 3 == len(made[0].triangle)
    d = directions(rng, 20_000)
    for o in ((0.2, -0.5, 4), (-2, 1, 0.1)):  # the second origin is inside an instance
        a, b = (look(m, o, d) for m in made)
        hit = (a["number"][:, 0] >= 0) & (b["number"][:, 0] >= 0)
        assert (a["number"][:, 0] >= 0).mean() > 0.02
        assert ((a["number"][:, 0] >= 0) == hit).mean() > 0.999  # except at silhouettes
        same = hit & (np.abs(a["point"] - b["point"]).max(1) < 1e-4)
        assert same.sum() > 0.999 * hit.sum()
        np.testing.assert_array_equal(a["number"][same], b["number"][same])
        for name in WIDTHS:
            asked = (
                same & (a["number"][:, 1] == 0) if name == "tangent" else same
            )  # the other material has no normal map, so no tangent
            good = np.abs(a[name][asked] - b[name][asked]).max(1) < 3e-4
            assert not len(good) or good.mean() > (0.99 if name == "tangent" else 0.999), (
                name
            )  # a hit at an edge may be on either triangle
        assert a["color"][hit].min() < 0.5
        assert (np.linalg.norm(a["tangent"][hit & (a["number"][:, 1] == 0), :3], axis=1) > 0.9).all()


def test_stretched_instance_normals_are_perpendicular(monkeypatch):
    """Normals are transformed by cofactors, not by the matrix: they equal the cross product of the copied triangle's edges."""
    rng = np.random.default_rng(2)
    place = turned(rng) @ np.diag([3.0, -0.4, 1.0, 1.0]) @ turned(rng)
    made = []
    for which in ("copied", "kept once"):
        keep_as(which, monkeypatch)
        made.append(compile_scene(description_of(icosphere(1), [place, turned(rng, 1, at=(50, 0, 0))])))
    d = directions(rng, 5000)
    a, b = (look(m, (0, 0, 0.1), d) for m in made)
    assert (b["number"][:, 0] == 0).all()
    same = np.abs(a["point"] - b["point"]).max(1) < 1e-4
    assert same.mean() > 0.999
    cosine = (a["geometric"] * b["geometric"]).sum(1)
    assert (cosine[same] > 1 - 1e-5).mean() > 0.998
    np.testing.assert_allclose(np.linalg.norm(b["geometric"], axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(b["shading"], b["geometric"], atol=1e-5)  # flat shading
    np.testing.assert_array_equal(a["number"][same, 3], 0)  # seen from inside
    np.testing.assert_array_equal(b["number"][same, 3], 0)


def tetrahedron():
    """Returns a tetrahedron, whose faces meet at 70 degrees."""
    corners = np.array([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)], np.float32)
    return Mesh("tetrahedron", corners, np.array([(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2)], np.int32))


def slab():
    """Returns a box 6 long and 0.04 thin, whose narrow sides are slivers with large float32 errors of hit distances."""
    mesh = box(0)
    mesh.positions = mesh.positions * np.float32([1, 0.02, 3])
    return mesh


@grid("scale", [1e-3, 1.0, 1e3], ordinary=(1.0,))
@grid("away", [0.0, 300.0], ordinary=(300.0,))
def test_paths_do_not_leave_a_closed_room(sharing, scale, away):
    """No path leaves a room of size 2, not even 300 units from the origin, where float32 has a step of 1.5e-5."""
    rng = np.random.default_rng(3)
    places = [turned(rng, scale, at=np.array((1, 0.7, -0.6)) * away * scale), turned(rng, scale, at=(0, 0, 9000 * scale))]
    for mesh in (box(0), icosphere(1), tetrahedron(), slab()):
        made = compile_scene(description_of(mesh, places, [Material()]))
        assert (len(made.to_world) > 0) == (sharing == "kept once")
        assert (wander(made, places[0][:3, 3], 15_000, 20) == 20).all()


@grid("scale", [1e-3, 1.0, 1e3], ordinary=(1e-3,))
@pytest.mark.parametrize("away", [0.0, 300.0])
def test_convex_bodies_do_not_shadow_themselves(sharing, scale, away):
    rng = np.random.default_rng(4)
    at = np.array((1, 0.7, -0.6)) * away * scale
    for mesh in (box(0), icosphere(2)):
        made = compile_scene(
            description_of(mesh, [turned(rng, scale, at=at), turned(rng, scale, at=at + 9e4 * scale)], [Material()])
        )
        to = directions(rng, 30_000)
        hits, met = touch(
            made, at + 3 * scale * to[:1], at + scale * rng.uniform(-0.7, 0.7, to.shape) - (at + 3 * scale * to[:1])
        )
        assert hits.mean() > 0.5
        assert not met.any()


@pytest.mark.parametrize("radius", [1e-3, 1.0, 1e5])
def test_sphere_has_no_self_shadows_or_leaks(radius):
    """Rays leaving a sphere do not hit it again: walls of smallpt's box have a radius of 1e5 and pass near the origin."""
    rng = np.random.default_rng(5)
    for center in ((0, -radius, 0), (81.6 + radius, 40.8, 81.6)):
        made = scene([Material()], spheres=(Sphere(center, radius, 0),))
        near = np.array(center) * (1 - radius / np.linalg.norm(center)) if center[0] == 0 else np.array((81.6, 40.8, 81.6))
        size = min(radius, 50.0)
        out = (near - np.array(center)) / radius
        o = near + size * out
        to = -out + rng.uniform(-0.5, 0.5, (30_000, 3)) * rng.choice([1e-6, 1e-3, 1.0], (30_000, 1))
        hits, met = touch(made, o - made.origin, to)
        assert hits.mean() > 0.8
        assert not met.any()
        assert (wander(made, center - made.origin, 3000, 20) == 20).all()


def test_lifted_point_is_on_the_smooth_sphere():
    """Ray origins on a coarse ball with smooth normals are offset to the true sphere; its facets lie up to 5 % further inside."""
    ball = painted(1)
    made = compile_scene(description_of(ball, [np.eye(4)], [Material()]))
    found = look(made, (0, 0, 3), directions(np.random.default_rng(6), 40_000))
    hit = found["number"][:, 0] >= 0
    flat, lifted = (np.linalg.norm(found[name][hit], axis=1) for name in ("point", "shadow_point"))
    assert flat.min() < 0.96
    assert lifted.min() > 0.999
    assert lifted.max() < 1 + 1.5 * (1 - flat.min())
    straight = np.linalg.norm(found["start"][hit], axis=1)  # towards the viewer, who is above most facets
    assert np.median(straight - flat) < 1e-4
    inside = look(made, (0.1, 0, 0), directions(np.random.default_rng(7), 5000))  # a concave surface needs no lifting
    np.testing.assert_array_equal(inside["point"], inside["shadow_point"])


def test_flat_triangles_are_not_lifted():
    made = compile_scene(description_of(icosphere(1), [np.eye(4)], [Material()]))
    found = look(made, (0, 0, 3), directions(np.random.default_rng(8), 20_000))
    np.testing.assert_array_equal(found["point"], found["shadow_point"])


def test_bent_normals_do_not_leak(monkeypatch):
    """No ray leaves a closed room with strongly bent normals: neither a ball with random ones nor a box with smoothed edges."""
    rng = np.random.default_rng(9)
    ball = icosphere(2)
    ball.normals = directions(rng, len(ball.positions))
    made = compile_scene(description_of(ball, [np.eye(4)], [Material()]))
    assert (wander(made, (0, 0, 0), 20_000, 20) == 20).all()


def test_missing_attributes_have_neutral_values():
    """Missing vertex attributes have neutral values; second coordinates default to the first."""
    found = look(scene([Material()], (box(0),)), (0, 0, 3), np.tile(np.float32([0, 0, -1]), (4, 1)))
    np.testing.assert_array_equal(found["color"], 1)
    np.testing.assert_array_equal(found["uv1"], found["uv"])
    np.testing.assert_array_equal(found["tangent"], 0)
