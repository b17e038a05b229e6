"""Tests of exact annotation against all primitives, ray by ray, in float64."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from renderer.annotation import AFTER, BEFORE, NOW, annotate, bodies_of, flow_to
from renderer.exposure import pixel_times, window_between
from renderer.scene.animation import BETWEEN, Moment, Shutter
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Instance, Material, Mesh, SceneDescription, Sphere
from renderer.scene.shutter_merge import merge_over_shutter
from renderer.settings import RenderSettings, View
from tests.renderer.builders import gray, square

WIDTH, HEIGHT = 61, 47
VIEW = View((0.7, 0.9, 4.1), (0.05, 0.1, 0.0), fov=50.0, shift_x=0.06, shift_y=-0.04)
F64 = np.ndarray
MATERIALS = [
    Material(base_color=gray(0.7), name="matt"),
    Material(base_color=gray(0.7), opacity=0.3, alpha_mode="blend", name="sheer"),
    Material(emission=gray(2.0), name="lamp"),
]
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32)
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
CUBE = np.array([t for a, b, c, d in SIDES for t in ((a, b, c), (a, c, d))], np.int32)


def turned(angle: float, scale: float, place: tuple[float, float, float]) -> F64:
    matrix = np.eye(4)
    matrix[:3, :3] = scale * np.array(
        [[math.cos(angle), 0.3 * math.sin(angle), math.sin(angle)], [0.1, 1, 0], [-math.sin(angle), 0, math.cos(angle)]]
    )
    matrix[:3, 3] = place
    return matrix


def described(offset: float = 0.0, moves: bool = False) -> SceneDescription:
    """Returns a floor, a sheer pane before all, two cubes of one mesh of which the second may move, two balls of one name."""
    cube = Mesh("cube", CORNERS, CUBE)
    pane = square((0.3, 0.4, 2.0), (0.5, 0, 0), (0, 0.5, 0), 1)
    floor = square((0, -0.62, 0), (2.1, 0, 0), (0, 0, -2.2), 0)
    placed = turned(0.9, 0.31, (0.61 + 0.2 * offset, 0.03, 0.52))
    return SceneDescription(
        meshes=[floor, pane, cube],
        instances=[
            Instance(0, name="floor"),
            Instance(1, name="pane"),
            Instance(2, turned(0.4, 0.42, (-0.23, -0.1, -0.31)), name="first"),
            Instance(2, placed, name="second", moves=moves),
        ],
        spheres=[Sphere((-0.81, 0.37, 0.24), 0.33, 2, "near"), Sphere((0.12, 0.71, -1.13), 0.55, 0, "far")],
        materials=list(MATERIALS),
        environment=Environment(gray(1.0)),
        moves=moves,
    )


def settings(view: View = VIEW) -> RenderSettings:
    return RenderSettings(WIDTH, HEIGHT, view)


def pixel_rays(view: View) -> tuple[F64, F64]:
    """Returns the eye and the directions (h, w, 3) through the pixel centres, of length 1 along the line of sight."""
    forward = np.subtract(view.target, view.eye)
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, view.up)
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH] + 0.5
    pixel = 2 * math.tan(math.radians(view.fov) / 2) / HEIGHT
    x, y = (x - WIDTH / 2 + view.shift_x * HEIGHT) * pixel, (HEIGHT / 2 + view.shift_y * HEIGHT - y) * pixel
    return np.array(view.eye), forward + x[..., None] * right + y[..., None] * up


def all_hits(description: SceneDescription, eye: F64, d: F64) -> list[tuple[int, F64]]:
    """Returns (object, distance along d) of each primitive that is not sheer, in whatever order; inf where it is missed."""
    found = []
    for number, instance in enumerate(description.instances):
        mesh = description.meshes[instance.mesh]
        if mesh.material == 1:
            continue
        points = mesh.positions.astype(np.float64) @ instance.transform[:3, :3].T + instance.transform[:3, 3]
        for a, b, c in points[mesh.triangles]:
            normal = np.cross(b - a, c - a)
            with np.errstate(divide="ignore", invalid="ignore"):
                t = ((a - eye) @ normal) / (d @ normal)
                p = eye + t[..., None] * d
                sides = [np.cross(v - u, p - u) @ normal for u, v in ((a, b), (b, c), (c, a))]
                inside = np.all([side >= 0 for side in sides], axis=0) & (t > 0)
            found.append((number, np.where(inside, t, np.inf)))
    for number, ball in enumerate(description.spheres, len(description.instances)):
        o = eye - np.array(ball.center)
        a, b, c = (d * d).sum(-1), d @ o, o @ o - ball.radius**2
        inner = b * b - a * c
        for sign in (-1, 1):
            t = (-b + sign * np.sqrt(np.where(inner > 0, inner, np.nan))) / a
            found.append((number, np.where((inner > 0) & (t > 0), t, np.inf)))
    return found


def test_ids_depth_and_layers_are_those_of_all_primitives() -> None:
    """A moving cube is stored as an instance, everything else in world space; the sheer pane is not met."""
    still, moving = described(), described(moves=True)
    eye, d = pixel_rays(VIEW)
    hits = all_hits(still, eye, d)
    distance = np.array([t for _, t in hits])
    nearest = distance.min(axis=0)
    first = np.where(np.isfinite(nearest), np.array([n for n, _ in hits])[distance.argmin(axis=0)], -1)
    assert {*np.unique(first).tolist()} == {-1, 0, 2, 3, 4, 5}
    for description in (still, moving):
        compiled = compile_scene(description)
        assert (len(compiled.to_world) > 0) == (description is moving)
        found = annotate(compiled, settings())
        np.testing.assert_array_equal(found.object, first)
        np.testing.assert_array_equal(found.instance >= 0, (first == 3) & (description is moving))
        places = eye + nearest[..., None] * d
        met = first >= 0
        np.testing.assert_allclose(found.places_at(NOW)[met, :3], places[met], atol=2e-5)
        for number in range(6):
            whole = np.any([np.isfinite(t) for n, t in hits if n == number] or [np.zeros(first.shape, bool)], axis=0)
            listed = (found.layers[..., 0] == number).any(axis=2)
            np.testing.assert_array_equal(listed, whole, err_msg=str(number))
        assert found.material[met & (first != 4)].max() == 0 and found.material[first == 4].min() == 2
        assert np.allclose(np.linalg.norm(found.normal[met], axis=-1), 1.0, atol=1e-6)
        assert ((found.normal[met] * d[met]).sum(-1) < 0).all()


def test_boxes_hold_the_vertices() -> None:
    for moves in (False, True):
        description = described(moves=moves)
        bodies = {body.object: body for body in bodies_of(compile_scene(description))}
        assert sorted(bodies) == [0, 1, 2, 3, 4, 5]
        assert (bodies[3].instance >= 0) == moves
        points = CORNERS @ description.instances[3].transform[:3, :3].T + description.instances[3].transform[:3, 3]
        if moves:  # the box of an instance is aligned with it: a cube's are the vertices
            expected = sorted(points.round(4).tolist())
            np.testing.assert_allclose(sorted(bodies[3].corners.round(4).tolist()), expected, atol=2e-4)
        else:
            np.testing.assert_allclose(bodies[3].corners[[0, 7]], [points.min(0), points.max(0)], atol=1e-5)
        ball = description.spheres[1]
        np.testing.assert_allclose(bodies[5].corners[7], np.add(ball.center, ball.radius), atol=1e-6)


def test_flow_is_the_motion_of_points_and_hides_what_others_occlude() -> None:
    """The second cube flies; each end of the flow is where its point is at that time, in the other camera's picture."""
    other = replace(VIEW, eye=(0.2, 1.1, 3.9), target=(0.1, 0.0, 0.1))
    still = described()
    compiled = compile_scene(merge_over_shutter(lambda moment: described(moment.offset, moves=True), Moment(), BETWEEN))
    found = annotate(compiled, settings(), layers=False)
    eye, d = pixel_rays(VIEW)
    distance = np.array([t for _, t in all_hits(still, eye, d)]).min(axis=0)
    for when, sign in ((BEFORE, -1.0), (AFTER, 1.0)):
        flow = flow_to(compiled, settings(), found, other, when)
        points = eye + np.where(np.isfinite(distance), distance, 1e12)[..., None] * d
        points[found.object == 3] += sign * np.array([0.2, 0.0, 0.0])
        forward = np.subtract(other.target, other.eye) / np.linalg.norm(np.subtract(other.target, other.eye))
        right = np.cross(forward, other.up)
        right /= np.linalg.norm(right)
        x, y, z = np.moveaxis((points - other.eye) @ np.stack([right, np.cross(right, forward), forward]).T, -1, 0)
        pixel = 2 * math.tan(math.radians(other.fov) / 2) / HEIGHT
        ends = np.stack(
            [x / z / pixel + WIDTH / 2 - other.shift_x * HEIGHT, HEIGHT / 2 + other.shift_y * HEIGHT - y / z / pixel], -1
        )
        starts = np.stack(np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5), -1)
        np.testing.assert_allclose(flow.offset, ends - starts, atol=1e-3)
        there = np.array(other.eye)
        way = points - there
        before = np.array([t for _, t in all_hits(described(sign), there, way)]).min(axis=0)
        outside = ~((ends >= 0) & (ends <= (WIDTH, HEIGHT))).all(-1)
        clear = np.abs(before - 1) > 1e-3  # where a point is its own occluder, rounding decides
        expected = outside | (before < 1 - 1e-3)
        np.testing.assert_array_equal(flow.occluded[clear | outside], expected[clear | outside])
        assert not flow.occluded[~clear & ~outside].any()
        assert (expected & ~outside).sum() > 20 and (~expected).sum() > 500


def test_the_window_of_flow_covers_the_exposures_of_both_neighbours() -> None:
    assert window_between(settings()) == BETWEEN and not pixel_times(settings(), BETWEEN).is_rolling
    for at, reach in (("centred", 0.25), ("trailing", 0.5), ("leading", 0.5)):
        rolled = replace(settings(), shutter=0.5, rolling_shutter=1.0, shutter_at=at)
        window = window_between(rolled)
        assert window.length == 2 + 2 * reach and window.keys % 2 == 1 and window.length / (window.keys - 1) <= 0.125
        times = pixel_times(rolled, window)
        ends = times.at(np.zeros(2), np.array([0.0, HEIGHT]))
        shares = {"centred": (-0.25, 0.25), "trailing": (-0.5, 0.0), "leading": (0.0, 0.5)}[at]
        np.testing.assert_allclose((ends - 0.5) / times.frame, shares, atol=1e-12)
        assert ends.min() - times.frame > -1e-12 and ends.max() + times.frame < 1 + 1e-12


@pytest.mark.long
@pytest.mark.parametrize("edge", ["top", "left"])
def test_a_rolling_shutter_gives_each_row_its_own_time(edge: str) -> None:
    """Ids and positions are those of all primitives at the time of each row; flow ends where a row of the next frame is."""
    rolled = replace(settings(), shutter=0.8, shutter_at="trailing", rolling_shutter=0.75, rolling_shutter_from=edge)
    count = HEIGHT if edge == "top" else WIDTH
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH] + 0.5
    eye, d = pixel_rays(VIEW)

    def moment_of(position: F64) -> F64:
        """Returns the middle of the exposure at a row or column, in frames from the picture's."""
        return -0.8 + 0.8 * (0.125 + 0.75 * position / count)

    own = moment_of(y if edge == "top" else x)
    first, places = np.full(own.shape, -1), np.zeros((*own.shape, 3))
    for line in range(count):
        part = np.s_[line] if edge == "top" else np.s_[:, line]
        hits = all_hits(described(float(moment_of(np.array(line + 0.5)))), eye, d[part])
        distance = np.array([t for _, t in hits])
        nearest = distance.min(axis=0)
        met = np.isfinite(nearest)
        first[part] = np.where(met, np.array([n for n, _ in hits])[distance.argmin(axis=0)], -1)
        places[part] = eye + np.where(met, nearest, 0.0)[:, None] * d[part]

    window = window_between(rolled)

    def over(shutter: Shutter) -> SceneDescription:
        return merge_over_shutter(lambda moment: described(moment.offset, moves=True), Moment(), shutter)

    for shutter, passed in ((Shutter(0.8, "trailing"), None), (window, window)):
        found = annotate(compile_scene(over(shutter)), rolled, window=passed)
        np.testing.assert_array_equal(found.object, first)
        np.testing.assert_allclose(found.places_at(NOW)[first >= 0, :3], places[first >= 0], atol=3e-5)
        np.testing.assert_array_equal(found.layers[:, :, 0, 0], first)
    other = replace(VIEW, eye=(0.6, 0.95, 4.0))
    compiled = compile_scene(over(window))
    found = annotate(compiled, rolled, layers=False, window=window)
    forward = np.subtract(other.target, other.eye) / np.linalg.norm(np.subtract(other.target, other.eye))
    right = np.cross(forward, other.up)
    right /= np.linalg.norm(right)
    pixel = 2 * math.tan(math.radians(other.fov) / 2) / HEIGHT
    for when, sign in ((BEFORE, -1.0), (AFTER, 1.0)):
        flow = flow_to(compiled, rolled, found, other, when, window=window)
        ends = np.stack([x, y], -1) + flow.offset
        inside = ((ends >= 0) & (ends <= (WIDTH, HEIGHT))).all(-1) & (first >= 0)
        later = sign + moment_of(ends[..., 1] if edge == "top" else ends[..., 0]) - own
        points = places + np.where(first == 3, 0.2 * later, 0.0)[..., None] * np.array([1.0, 0.0, 0.0])
        a, b, c = np.moveaxis((points - other.eye) @ np.stack([right, np.cross(right, forward), forward]).T, -1, 0)
        expected = np.stack(
            [a / c / pixel + WIDTH / 2 - other.shift_x * HEIGHT, HEIGHT / 2 + other.shift_y * HEIGHT - b / c / pixel], -1
        )
        np.testing.assert_allclose(ends[inside], expected[inside], atol=1e-3)
        assert inside.sum() > 1000 and (inside & (first == 3)).sum() > 50
        assert flow.occluded[~inside & (first >= 0)].all() and flow.occluded[inside].mean() < 0.2
        assert abs(ends - np.stack([x, y], -1))[inside & (first == 3)].max() > 2
