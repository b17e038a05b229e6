"""Tests of replaying one path: its value equals the film's to the bit, and its record adds up to that value."""

import itertools
import math

import numpy as np
import pytest

from renderer.errors import SettingsError
from renderer.film import COLOR, MATERIAL, OBJECT
from renderer.render import render_batch, render_frame, replay
from renderer.replay import ENDS
from renderer.scene.compiled import seal
from renderer.scene.description import Material, Sphere
from renderer.settings import INTEGRATORS, Tile
from tests.grids import grid
from tests.renderer.builders import box, emitter, gray, scene, settings, square

VIEW = ((0, 2, 6), (0, 0.5, 0), 40)


@pytest.fixture(scope="module")
def made():
    materials = [
        Material(base_color=(0.7, 0.6, 0.5)),
        Material(kind="glass", base_color=gray(1.0)),
        Material(kind="mirror", base_color=gray(0.9)),
        emitter(9.0),
        Material(base_color=(0.1, 0.8, 0.1), opacity=0.5, alpha_mode="blend"),
    ]
    meshes = (
        square((0, 0, 0), (9, 0, 0), (0, 0, -9), 0),
        box(2, 0.4, (0, 0.4, -1)),
        square((0, 3, 0), (1, 0, 0), (0, 0, 1), 3),
        square((0, 1, 2), (0.6, 0, 0), (0, 0.6, 0), 4),
    )
    return scene(materials, meshes, (Sphere((1.2, 0.6, 0), 0.6, 1),), environment=0.3)


@grid("integrator", INTEGRATORS, ordinary=("path", "direct"))
def test_replay_equals_the_films_sample(made, integrator):
    asked = settings(*VIEW, size=40, max_depth=6, integrator=integrator, filter="blackman-harris")
    for sample in (0, 1, 5, 100):
        film = render_batch(made, asked, Tile(0, 0, 40, 40), sample, 1).sums
        for x, y in ((3, 4), (20, 20), (28, 22), (16, 30), (22, 17)):
            found = replay(made, asked, x, y, sample)
            assert [int(v * 2**24) for v in found.value] == film[COLOR, y, x].tolist()
            total = np.sum([np.sum([v.emitted, v.direct, v.beside], axis=0) for v in found.vertices], axis=0)
            np.testing.assert_allclose(total, found.value, rtol=1e-5, atol=1e-6)
            if sample == 0 and found.vertices[0].kind == "surface":
                assert found.vertices[0].object == film[OBJECT, y, x] - 1
                assert found.vertices[0].material == film[MATERIAL, y, x] - 1


def test_replayed_vertices_are_connected(made):
    asked = settings(*VIEW, size=40, max_depth=6, transmission_depth=0)
    kinds = set()
    for y in range(0, 40, 3):
        for x in range(0, 40, 3):
            vertices = replay(made, asked, x, y, 3).vertices
            assert 1 <= len([v for v in vertices if v.kind == "surface"]) + (vertices[-1].kind == "missed") <= 6
            at = np.array(VIEW[0])
            before = None
            for v in vertices:
                kinds.add(v.kind)
                assert np.linalg.norm(v.direction) == pytest.approx(1, abs=1e-5)
                if v.kind == "missed":
                    assert v is vertices[-1]
                    assert v.point is v.object is v.material is None
                    assert v.distance == math.inf
                    continue
                np.testing.assert_allclose(
                    np.array(at) + np.multiply(v.direction, np.linalg.norm(np.subtract(v.point, at))), v.point, atol=1e-3
                )
                assert np.dot(v.normal, v.direction) < 1e-6
                if before is not None and before.kind == "passed":
                    assert v.throughput == before.throughput or v.kind == "surface"
                at, before = v.point, v
            assert vertices[0].throughput == (1, 1, 1)
            assert vertices[0].pdf is None
    assert kinds == {"surface", "passed", "missed"}


def test_replay_records_the_bsdf_pdf(made):
    """The recorded pdf of a diffuse bounce is cos / pi, twice that if the path splits there; after a mirror there is none."""
    asked = settings(*VIEW, size=40, max_depth=6)
    seen = 0
    for x in range(40):
        vertices = replay(made, asked, x, 34, 1).vertices
        if len(vertices) > 1 and vertices[0].material == 0 and vertices[0].kind == "surface":
            cosine = np.dot(vertices[0].normal, vertices[1].direction)
            assert vertices[1].pdf == pytest.approx(2 * cosine / math.pi, rel=1e-3)
            seen += 1
    assert seen > 20


@pytest.mark.parametrize(
    ("material", "asked", "end"),
    [
        (Material(base_color=gray(1.0)), {"diffuse_depth": 2}, "diffuse"),
        (Material(kind="mirror", base_color=gray(1.0)), {"glossy_depth": 2}, "glossy"),
        (Material(kind="glass", base_color=gray(1.0), ior=1.0), {"transmission_depth": 1}, "transmission"),
        (Material(opacity=0.0, alpha_mode="blend"), {"transparency_depth": 1}, "passed"),
        (Material(kind="unlit"), {"diffuse_depth": 2}, "unlit"),
        (Material(base_color=gray(1.0)), {"max_depth": 2, "diffuse_depth": 2}, "depth"),
    ],
)
def test_replay_records_the_reached_limit(material, asked, end):
    """In two nested spheres of one material, paths that pass the inner sphere end at the outer one, with the limit recorded."""
    made = scene([material], spheres=(Sphere((0, 0, 0), 1.0, 0), Sphere((0, 0, 0), 2.0, 0)))
    found = replay(made, settings((0, 0, 0), (0, 0, -1), 40, size=8, **{"max_depth": 64, **asked}), 3, 3, 0)
    assert found.end == end
    assert end in ENDS


def test_replay_of_a_bad_sample_has_no_value():
    made = scene([Material(base_color=gray(0.5))], (square((0, -50, -1), (99, 0, 0), (0, 50, 0), 0),), environment=1.0)
    poisoned = seal(made._replace(environment=np.full((1, 1, 3), np.nan, np.float32)))
    asked = settings((0, 0, 0), (0, 0, -1), 60, size=16, max_depth=1)
    found = replay(poisoned, asked, 3, 3, 0)
    assert found.value is None
    assert found.vertices[-1].kind == "missed"
    assert np.isnan(found.vertices[-1].emitted).all()


@pytest.mark.parametrize(
    ("x", "y", "sample", "word"), [(40, 0, 0, "pixel"), (0, -1, 0, "pixel"), (0, 0, -1, "sample"), (0, 0, 1 << 20, "sample")]
)
def test_replay_out_of_range_is_an_error(made, x, y, sample, word):
    with pytest.raises(SettingsError, match=f"^{word}"):
        replay(made, settings(*VIEW, size=40), x, y, sample)


def test_rendering_writes_no_log(made):
    """A frame rendered while logging paths equals one rendered without."""
    asked = settings(*VIEW, size=16, max_depth=4)
    before = render_frame(made, asked, 2)
    replay(made, asked, 3, 3, 1)
    np.testing.assert_array_equal(render_frame(made, asked, 2), before)


def test_replay_records_the_chosen_lamp(made):
    """A path's record names the chosen lamp and its contribution, reduced by a pane's transmission; MIS weights are 0 to 1."""
    asked = settings(*VIEW, size=40, max_depth=6)
    brought, blocked, shares = 0, 0, []
    for x, y in itertools.product(range(0, 40, 2), (22, 34)):
        for sample in range(4):
            for v in replay(made, asked, x, y, sample).vertices:
                if v.share is not None:
                    shares.append(v.share)
                if v.lamp is None:
                    assert v.direct == (0, 0, 0)
                    continue
                shares.append(v.lamp.share)
                if v.lamp.point is not None:  # the world's only area light: a quad at a height below 3
                    assert v.lamp.point[1] == pytest.approx(3, abs=1e-3)
                if any(v.direct):
                    part = v.direct[0] / v.lamp.brought[0]  # the pane in the middle transmits half of the light, twice a quarter
                    assert min(abs(part - known) for known in (1, 0.5, 0.25)) < 1e-4
                    brought += 1
                else:
                    blocked += 1
    assert brought > 20
    assert blocked > 0
    assert all(0 <= share <= 1 for share in shares)
    assert any(share < 1 for share in shares)


def test_replay_records_the_end_reason(made):
    asked = settings(*VIEW, size=40, max_depth=12, roulette=0.5)
    ends = {}
    for x in range(0, 40, 2):
        for sample in range(6):
            path = replay(made, asked, x, 34, sample)
            ends.setdefault(path.end, path)
            for v in path.vertices[:-1]:
                assert v.kind == "passed" or 0 < v.survival <= 1
    assert {"missed", "roulette"} <= ends.keys() <= set(ENDS)
    assert ends["missed"].vertices[-1].kind == "missed"
    assert ends["roulette"].vertices[-1].survival == 0.5
    assert replay(made, settings(*VIEW, size=40, max_depth=1), 20, 34, 0).end == "depth"
