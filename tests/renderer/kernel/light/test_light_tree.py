"""Tests of the light tree: it chooses lights with the probability that it states, and can choose every contributing light."""

import numpy as np
import pytest

from renderer.arrays.light_rows import CHILD, CORNER_ERROR, END, NO_END
from renderer.arrays.rows import PART_MATERIAL
from renderer.jit import entry
from renderer.kernel.light.light_tree import sample_light_tree, tree_probability
from renderer.scene.description import Light, Material, Sphere
from renderer.scene.lights import TREE_FROM, with_light_choice
from tests.renderer.builders import emitter, gray, scene, square
from tests.renderer.judge import chi_squared, limit

POINTS = 40


@entry
def _choose(nodes, p, n, u, light, chance, again):
    point, normal = (p[0], p[1], p[2]), (n[0], n[1], n[2])
    for i in range(len(u)):
        light[i], chance[i] = sample_light_tree(nodes, point, normal, u[i])
        again[i] = tree_probability(nodes, point, normal, np.int32(light[i]))


@entry
def _chances(nodes, p, n, chance):
    for light in range(len(chance)):
        chance[light] = tree_probability(nodes, (p[0], p[1], p[2]), (n[0], n[1], n[2]), np.int32(light))


def chances(made, p, n):
    out = np.zeros(len(made.light_primitive), np.float32)
    _chances(made.light_node, np.array(p, np.float32), np.array(n, np.float32), out)
    return out


def room(seed=0, spheres=60, squares=60, points=40, spots=30, suns=3):
    """Returns lights of all kinds in a box of side 20; their powers differ by up to a factor of a million."""
    rng = np.random.default_rng(seed)
    materials = [Material(), *(emitter(10 ** rng.uniform(-3, 3), double_sided=bool(i % 2)) for i in range(20))]

    def place():
        return tuple(rng.uniform(-10, 10, 3))

    def some_material():
        return int(rng.integers(1, 21))

    meshes = [square(place(), *rng.normal(0, 0.3, (2, 3)), some_material()) for _ in range(squares)]
    balls = tuple(Sphere(place(), rng.uniform(0.01, 0.5), some_material()) for _ in range(spheres))
    lights = [
        *(Light("point", gray(10 ** rng.uniform(-3, 3)), place(), radius=0.1 * (i % 2)) for i in range(points)),
        *(
            Light("spot", gray(10 ** rng.uniform(-3, 3)), place(), tuple(rng.normal(size=3)), outer_cone=rng.uniform(1, 120))
            for _ in range(spots)
        ),
        *(Light("directional", gray(0.5), direction=tuple(rng.normal(size=3)), angle=2.0 * i) for i in range(suns)),
    ]
    return scene(materials, tuple(meshes), balls, lights=tuple(lights))


@pytest.fixture(scope="module")
def made():
    return room()


def points_and_normals(seed=1, count=POINTS):
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=(count, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal[::4] = 0  # lit from all sides
    return rng.uniform(-14, 14, (count, 3)), normal


def test_each_light_is_one_leaf_in_tree_order(made):
    child, end = (made.light_node[:, row].view(np.int32) for row in (CHILD, END))

    def lights_below(node, begin):
        """Asserts that the lights below a node are numbered in order, from `begin`; returns the number after the last of them."""
        for k in np.flatnonzero(end[node] != NO_END):
            begin = lights_below(child[node, k], begin) if child[node, k] >= 0 else begin + (child[node, k] == ~begin)
            assert end[node, k] == begin
        return begin

    assert len(made.light_primitive) >= TREE_FROM
    assert lights_below(0, 0) == len(made.light_primitive)
    assert np.array_equal(np.sort(child[child > 0]), np.arange(1, len(child)))
    assert len(set(made.light_primitive.tolist())) == len(made.light_primitive)
    for primitive, light in enumerate([*made.triangle_light, *made.sphere_light]):
        of_lamp = len(made.light_parallelogram) and made.light_parallelogram[light, CORNER_ERROR] > 0
        assert light < 0 or made.light_primitive[light] == primitive or (of_lamp and made.light_primitive[light] == primitive - 1)


@pytest.mark.long
def test_light_probabilities_sum_to_at_most_one(made):
    """The probabilities of all lights sum to at most 1: less if the descent can end at a node without any light.

    At such a dead end, the bounds of a node may contribute to a point, although the bounds of neither child do.
    """
    sums = np.array([chances(made, p, n).astype(float).sum() for p, n in zip(*points_and_normals(), strict=True)])
    assert sums.max() < 1 + 1e-5
    assert sums.mean() > 0.7  # with spots in all directions and such powers, many descents end


@pytest.mark.long
def test_light_frequencies_match_the_tree(made):
    rng = np.random.default_rng(3)
    count = 100_000
    for p, n in zip(*points_and_normals(count=12), strict=True):
        light, chance, again = np.zeros(count, np.int64), np.zeros(count, np.float32), np.zeros(count, np.float32)
        _choose(made.light_node, p.astype(np.float32), n.astype(np.float32), rng.random(count, np.float32), light, chance, again)
        assert np.array_equal(chance[chance > 0], again[chance > 0])
        expected = chances(made, p, n)
        ended = chance == 0
        assert np.array_equal(chance[~ended], expected[light[~ended]])
        counts = np.append(np.bincount(light[~ended], minlength=len(expected)), ended.sum())
        rest = max(1 - expected.astype(float).sum(), 0)
        chi_squared(counts, np.append(expected, rest) * (count / (expected.astype(float).sum() + rest)), 12)


def angle(a, b):
    return np.arctan2(np.linalg.norm(np.cross(a, b)), np.dot(a, b))


def received(towards, radius, n):
    """Returns the irradiance that the light tree estimates at a point with normal n, from a sphere of unit intensity.

    towards: the vector from the point to the sphere's centre. If n is zero, the estimate is independent of direction.
    """
    far = max(np.linalg.norm(towards), np.sqrt(0.3) * radius)
    height = np.dot(towards, n)
    return (np.clip((max(height, 0.3 * height) + 0.3 * radius) / far, 0, 1) if n.any() else 1.0) / far**2


def plain_importance(light, p, n):
    """Returns the importance of one light at a point p with normal n, computed from angles in float64.

    It is NaN near the edge of a spot's cone, where the tree has a margin for float32 rounding.
    """
    if light.kind == "directional":
        towards = -np.array(light.direction) / np.linalg.norm(light.direction)
        return light.intensity[0] * received(towards, np.sin(np.radians(light.angle / 2)), n)
    away = p - np.array(light.position)
    seen_under = np.arcsin(light.radius / np.linalg.norm(away))
    spread = np.radians(light.outer_cone) if light.kind == "spot" else np.pi
    beyond = angle(light.direction, away) - spread - seen_under
    lit = np.nan if abs(beyond) < 0.01 else float(beyond < 0)
    return light.intensity[0] * lit * received(-away, light.radius, n)


def test_probabilities_in_a_node_match_the_importance_formula():
    """Eight punctual lights in the root node, whose bounds are exact, are chosen in proportion to the importance formula."""
    lamps = (
        *(Light("point", gray(2.0**i), (i - 2.0, 3.0, i % 2), radius=0.4 * i) for i in range(3)),
        *(Light("spot", gray(9.0), (i, 2.0, -1.0), (0.3 * i, -1, 0.2), outer_cone=20 + 40 * i, radius=0.1 * i) for i in range(3)),
        *(Light("directional", gray(0.3 + i), direction=(i, -1.0, 0.5), angle=20.0 * i) for i in range(2)),
    )
    made = scene([Material()], (square((0, 0, 0), (1, 0, 0), (0, 0, -1), 0),), lights=lamps)
    order = made.light_primitive - 2
    assert len(made.light_node) == 1
    judged = 0
    for p, n in zip(*points_and_normals(count=60), strict=True):
        expected = np.array([plain_importance(lamps[i], p, n) for i in order])
        if expected.sum() > 0:
            judged += 1
            np.testing.assert_allclose(chances(made, p, n), expected / expected.sum(), atol=2e-3)
    assert judged > 40


def test_suns_are_chosen_by_irradiance_and_horizon():
    """A sun is chosen by its irradiance on surfaces facing it, anywhere in the scene, and never if it is below the horizon."""
    lamps = (
        *(Light("point", gray(1.0), (0.0, 1.0, 0.1 * i)) for i in range(20)),
        Light("directional", gray(1.0), direction=(0.0, -1.0, 0.0)),
        Light("directional", gray(1.0), direction=(0.0, 1.0, 0.0)),
    )
    made = scene([Material()], (square((0, 0, 0), (1, 0, 0), (0, 0, -1), 0),), lights=lamps)
    order = (made.light_primitive - 2).tolist()
    above, below = order.index(20), order.index(21)
    far = chances(made, (100.0, 0.0, 0.0), (0, 1, 0))
    assert far[above] > 0.99
    assert far[below] == 0
    assert 0.02 < chances(made, (0.0, 0.0, 1.0), (0, 1, 0))[above] < 0.2
    turned = chances(made, (100.0, 0.0, 0.0), (0, -1, 0))
    assert turned[above] == 0
    assert turned[below] == pytest.approx(1)


def reaches(made, light, p, n):
    """Returns whether some point of a light certainly illuminates p with normal n, in float64 with a margin."""

    def above(q):
        return not n.any() or ((q - p) @ n / np.linalg.norm(q - p, axis=-1)).max() > 1e-3

    primitive, triangles, spheres = made.light_primitive[light], len(made.triangle), len(made.sphere)
    if primitive < triangles:
        a, b, c = made.position[made.triangle[primitive, :3]].astype(float)
        normal = np.cross(b - a, c - a)
        towards = normal @ (p - a) / np.linalg.norm(normal) / np.linalg.norm(p - a)
        both = made.material[made.part[made.triangle[primitive, 3], PART_MATERIAL], 9] != 0
        return above(np.array([a, b, c])) and (abs(towards) if both else towards) > 1e-3
    if primitive < triangles + spheres:
        x = made.sphere[primitive - triangles].astype(float)
        return above(x[:3] + x[3] * n)
    row = made.punctual[primitive - triangles - spheres].astype(float)
    kind = made.punctual_kind[primitive - triangles - spheres]
    if kind == 2:
        return not n.any() or row[:3] @ n > 1e-3
    if kind == 1:
        cosine = row[3:6] @ (p - row[:3]) / np.linalg.norm(p - row[:3])
        if cosine * row[10] + row[11] <= 1e-3:
            return False
    return above(row[:3])


def test_every_contributing_light_has_positive_probability(made):
    judged = 0
    for p, n in zip(*points_and_normals(), strict=True):
        chance = chances(made, p, n)
        for light in range(len(chance)):
            if reaches(made, light, p, n):
                judged += 1
                assert chance[light] > 0, (light, made.light_primitive[light], p, n)
    assert judged > 20 * POINTS


def test_near_lamp_is_chosen_more_often():
    """In a row of equal lamps, the lamp above the point is chosen far more often than each would be by chance (1 in `count`).

    Lamps behind the point are never chosen.
    """
    lamps = tuple(Light("point", gray(1.0), (float(x), 1.0, 0.0)) for x in range(0, 100, 2))
    made = scene([Material()], (square((0, 0, 0), (1, 0, 0), (0, 0, -1), 0),), lights=lamps)
    chance = chances(made, (40.0, 0.0, 0.0), (0, 1, 0))
    by_place = {round(float(made.punctual[made.light_primitive[i] - 2, 0])): float(chance[i]) for i in range(len(chance))}
    assert max(by_place, key=by_place.get) == 40
    assert by_place[40] > 0.3
    assert chances(made, (40.0, 0.0, 0.0), (0, -1, 0)).sum() == 0


def test_power_and_uniform_choices_are_available(made):
    assert len(with_light_choice(made, "power").light_node) == 0
    assert with_light_choice(made, "tree") is made
    uniform = np.diff(with_light_choice(made, "uniform").light_cdf)
    np.testing.assert_allclose(uniform, 1 / len(uniform), rtol=1e-3)
    powers = np.diff(made.light_cdf)
    assert powers.max() / powers.min() > 100 > limit(1)


def test_coincident_lamps_are_distinguished():
    lamps = tuple(Light("point", gray(1.0 + i), (0.0, 1.0, 0.0)) for i in range(9))
    made = scene([Material()], (square((0, 0, 0), (1, 0, 0), (0, 0, -1), 0),), lights=lamps)
    chance = chances(made, (0.0, 0.0, 0.0), (0, 1, 0)).astype(float)
    order = made.light_primitive - 2
    np.testing.assert_allclose(chance[np.argsort(order)], np.arange(1, 10) / 45, rtol=1e-5)
