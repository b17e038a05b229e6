"""Tests of the benchmark of hard light: the arithmetic of its report, and that all renderers are given the same scenes."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from renderer.scene.description import SceneDescription
from tests.benchmarks import bench_hard
from tests.benchmarks.hard import renders
from tests.benchmarks.hard.blender_scene import BlenderScene, blender_scene
from tests.benchmarks.hard.luxcore_scene import luxcore_meshes, scene_properties
from tests.benchmarks.hard.rayfarm_files import HardCase, case_of
from tests.benchmarks.hard.renders import Reference, Render, reference_of
from tests.benchmarks.hard.report import Cell, Report, cell_of
from tests.benchmarks.hard.scenes import DEPTH, SCENES, SIZE, HardScene
from tests.grids import grid
from tests.peers.mitsuba_scene import mitsuba_dict


class Seen(NamedTuple):
    """Data of a scene as a renderer gets them. bounds: of each mesh or lamp, (N, 2, 3), sorted. power: rgb, of all lamps.

    camera: eye, unit direction of sight, and field of view.
    """

    bounds: np.ndarray
    power: np.ndarray
    camera: np.ndarray

    def matches(self, other: Seen) -> bool:
        """Returns whether all figures agree to single precision."""
        return all(np.allclose(a, b, rtol=1e-4, atol=1e-5) for a, b in zip(self, other, strict=True))


def box_of(points: Any) -> np.ndarray:
    points = np.asarray(points, float)
    return np.stack([points.min(0), points.max(0)])


def sorted_boxes(boxes: Any) -> np.ndarray:
    rounded = np.round(np.array(list(boxes)), 4) + 0.0
    return rounded[np.lexsort(rounded.reshape(len(rounded), -1).T)]


def area(points: Any, triangles: Any) -> float:
    a, b, c = (np.asarray(points, float)[np.asarray(triangles)[:, k]] for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def camera(eye: Any, target: Any, fov: float) -> np.ndarray:
    sight = np.subtract(target, eye)
    return np.array([*eye, *(sight / np.linalg.norm(sight)), fov])


def described(scene: HardScene) -> Seen:
    power = np.zeros(3)
    for part in scene.parts:
        surface = scene.surfaces[part.surface]
        if surface.kind == "light":
            power += math.pi * area(part.shape.positions, part.shape.triangles) * np.array(surface.color)
    bounds = sorted_boxes(box_of(part.shape.positions) for part in scene.parts)
    return Seen(bounds, power, camera(scene.eye, scene.target, scene.fov))


def seen_by_rayfarm(case: HardCase) -> Seen:
    description: SceneDescription = case.description
    power = np.zeros(3)
    for mesh in description.meshes:
        power += math.pi * area(mesh.positions, mesh.triangles) * np.array(description.materials[mesh.material].emission)
    bounds = sorted_boxes(box_of(mesh.positions) for mesh in description.meshes)
    return Seen(bounds, power, camera(case.view.eye, case.view.target, case.view.fov))


def seen_by_mitsuba(mi: Any, case: HardCase, folder: Path) -> Seen:
    made = mitsuba_dict(mi, case.description, case.settings(SIZE), folder)
    bounds, power = [], np.zeros(3)
    for part in made.values():
        if isinstance(part, dict) and part["type"] == "ply":
            shape = mi.load_dict({name: value for name, value in part.items() if name != "emitter"})
            bounds.append(np.array([shape.bbox().min, shape.bbox().max]))
            if "emitter" in part:
                power += math.pi * float(shape.surface_area()) * np.array(part["emitter"]["radiance"]["value"])
    to_world = np.array(made["sensor"]["to_world"].matrix, float)
    eye, sight = to_world[:3, 3], to_world[:3, 2]
    return Seen(sorted_boxes(bounds), power, camera(eye, eye + sight, made["sensor"]["fov"]))


def seen_by_blender(scene: BlenderScene) -> Seen:
    def back(vectors: Any) -> np.ndarray:
        x, y, z = np.moveaxis(np.asarray(vectors, float), -1, 0)
        return np.stack([x, z, -y], -1)

    bounds, power = [box_of(back(mesh.positions)) for mesh in scene.meshes], np.zeros(3)
    for mesh in scene.meshes:
        if scene.surfaces[mesh.surface].kind == "light":
            power += math.pi * area(mesh.positions, mesh.triangles) * np.array(scene.surfaces[mesh.surface].color)
    for lamp in scene.lamps:
        u, v = lamp.x_axis * lamp.size[0] / 2, lamp.y_axis * lamp.size[1] / 2
        bounds.append(box_of(back([lamp.center + s * u + t * v for s in (-1, 1) for t in (-1, 1)])))
        power += lamp.energy * np.array(lamp.color)
    return Seen(sorted_boxes(bounds), power, camera(back(scene.eye), back(scene.target), scene.fov))


def seen_by_luxcore(scene: HardScene) -> Seen:
    properties, meshes = scene_properties(scene), {mesh.name: mesh for mesh in luxcore_meshes(scene)}
    bounds, power = [], np.zeros(3)
    for name, value in properties.items():
        if name.startswith("scene.objects.") and name.endswith(".shape"):
            mesh = meshes[value]
            bounds.append(box_of(mesh.points))
            material = properties[name.replace(".shape", ".material")]
            emission = properties.get(f"scene.materials.{material}.emission", [0, 0, 0])
            power += math.pi * area(mesh.points, mesh.triangles) * np.array(emission)
    eye, target = properties["scene.camera.lookat.orig"], properties["scene.camera.lookat.target"]
    return Seen(sorted_boxes(bounds), power, camera(eye, target, properties["scene.camera.fieldofview"]))


@grid("name", SCENES, ordinary=("window", "niche"))
def test_all_renderers_are_given_the_same_scene(name: str, tmp_path: Path) -> None:
    scene = SCENES[name]()
    expected, case = described(scene), case_of(scene, tmp_path)
    assert case.settings(SIZE).max_depth == DEPTH
    assert seen_by_rayfarm(case).matches(expected)
    assert seen_by_luxcore(scene).matches(expected)
    for with_lamps in (False, True):
        made = blender_scene(scene, with_lamps)
        assert seen_by_blender(made).matches(expected)
        assert len(made.lamps) == (sum(surface.kind == "light" for surface in scene.surfaces.values()) if with_lamps else 0)
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    assert seen_by_mitsuba(mitsuba, case, tmp_path).matches(expected)


def test_lamps_shine_to_the_side_of_their_front() -> None:
    for make in SCENES.values():
        scene = make()
        for part, lamp in zip(
            [part for part in scene.parts if scene.surfaces[part.surface].kind == "light"],
            blender_scene(scene, True).lamps,
            strict=True,
        ):
            a, b, c = part.shape.positions[part.shape.triangles[0]]
            x, y, z = np.cross(b - a, c - a) / np.linalg.norm(np.cross(b - a, c - a))
            assert np.allclose(-lamp.z_axis, (x, -z, y)), (scene.name, part.name)


@grid("name", SCENES, ordinary=("vase",))
def test_meshes_are_not_degenerate_and_their_normals_are_outside(name: str) -> None:
    for part in SCENES[name]().parts:
        points, triangles, normals = part.shape
        a, b, c = (points[triangles[:, k]] for k in range(3))
        face = np.cross(b - a, c - a)
        assert (np.linalg.norm(face, axis=1) > 0).all(), part.name
        if normals is not None:
            assert np.allclose(np.linalg.norm(normals, axis=1), 1)
            assert (np.einsum("ij,ij->i", face, normals[triangles].sum(1)) > 0).all(), part.name
        if normals is not None and part.name != "water":  # closed, so that the outside is that of a positive volume
            assert np.einsum("ij,ij->", np.cross(a, b), c) > 0, part.name


def picture(value: float) -> np.ndarray:
    return np.full((SIZE, SIZE, 3), value, np.float32)


def reference(noise: float = 0.0) -> Reference:
    apart = np.random.default_rng(1).choice([-noise, noise], (SIZE, SIZE, 1)).astype(np.float32)
    return Reference(picture(2.0), (picture(2.0) + apart, picture(2.0) - apart), "ours", 1.0)


def test_efficiency_is_one_over_error_and_seconds() -> None:
    noisy = picture(2.0)
    noisy[::2] += 0.2
    noisy[1::2] -= 0.2
    cell = cell_of([Render(noisy, 5.0, 64, ""), Render(noisy, 4.0, 64, "")], reference())
    error = 0.04 / (4 * 1.01)
    assert cell.whole == pytest.approx((1 / (5 * error), 1 / (4 * error)))
    assert cell.median(trimmed=False) == pytest.approx(4.5 / 20 / error)
    assert (cell.share, cell.has_all_light, cell.is_limited) == (pytest.approx(1.0, abs=1e-6), True, False)
    noisy[0, 0] = 1e4  # one of 9,216 pixels
    cell = cell_of([Render(noisy, 5.0, 64, "")], reference())
    assert cell.efficiencies == pytest.approx((1 / (5 * error),), rel=1e-3)
    assert cell.whole[0] < 1e-3


def test_reference_with_an_error_of_its_own_makes_a_lower_bound() -> None:
    """The picture deviates by 0.2, and the halves differ by 0.1 or 0.2: their mean has 6 or 25 % of its squared error."""
    noisy = picture(2.0) + np.random.default_rng(2).choice([-0.2, 0.2], (SIZE, SIZE, 1)).astype(np.float32)
    assert not cell_of([Render(noisy, 1.0, 1, "")], reference(0.05)).is_limited
    cell = cell_of([Render(noisy, 1.0, 1, "")], reference(0.1))
    assert cell.is_limited
    assert cell.text(trimmed=True).startswith("> ")


def test_missing_light_is_told_from_noise() -> None:
    noise = np.random.default_rng(3).normal(0, 2.0, (SIZE, SIZE, 1)).astype(np.float32)
    assert cell_of([Render(picture(2.0) + noise - noise.mean(), 1.0, 1, "")], reference()).has_all_light
    cell = cell_of([Render(picture(1.7) + noise - noise.mean(), 1.0, 1, "")], reference())
    assert not cell.has_all_light
    assert cell.share == pytest.approx(0.85, abs=1e-5)
    assert cell.noise == pytest.approx(2.0 / SIZE / 2.0, rel=0.05)
    assert "0.85 of the light" in cell.text(trimmed=True)


def cell(efficiency: float, share: float = 1.0, whole: float | None = None) -> Cell:
    whole = efficiency if whole is None else whole
    return Cell((efficiency,), (whole,), False, False, share, 0.001, (1.0,), (64,))


def test_report_compares_with_off_and_with_both_kinds_of_peers() -> None:
    report = Report({"load": 1.0})
    report.cells = {
        ("ball", "caustics"): cell(80.0, whole=6.0),
        ("ball", "off"): cell(2.0),
        ("ball", "mitsuba"): cell(1.6),
        ("ball", "luxcore-bidir"): cell(100.0, share=0.8),
        ("ball", "cycles-caustics"): cell(160.0),
        ("door", "guiding"): cell(2.4),
        ("door", "off"): cell(2.0),
        ("door", "cycles"): cell(3.0),
    }
    report.missing["cycles-guided"] = "no network"
    ratios = {(v.scene, v.name): v for scene in ("ball", "door") for v in report.verdicts(scene, trimmed=True)}
    assert {key: round(v.value, 3) for key, v in ratios.items()} == {
        ("ball", "over `off`"): 40.0,
        ("ball", "over the best unbiased peer"): 50.0,  # bidirectional paths lack light, so they count as biased
        ("ball", "over the best biased peer"): 0.5,
        ("door", "over `off`"): 1.2,
        ("door", "over the best unbiased peer"): 0.8,
    }
    assert [v.name for v in ratios.values() if not v.goal.met(v.value)] == ["over `off`", "over the best unbiased peer"]
    text = report.text()
    assert "| `caustics: on` over `off` (goal) | 40 (20) |" in text
    assert "| LuxCore, bidirectional | 100, 0.80 of the light |" in text
    assert "caustic of a glass ball, LuxCore, bidirectional: 0.800 +- 0.001 of the reference's light" in text
    assert "ball, over `off`: 3, at least 20 is asked for, with all pixels" in text
    assert "Left out: Cycles with OpenPGL: no network" in text


class FakeRenderer:
    """A renderer whose pictures have the value of their seed."""

    made: list[int]

    def __init__(self) -> None:
        self.made = []

    def render(self, seconds: float, seed: int) -> Render:
        self.made.append(seed)
        return Render(picture(float(seed)), seconds, 10, "fake")


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> Iterator[FakeRenderer]:
    renderer = FakeRenderer()

    @contextlib.contextmanager
    def opened(*_: object) -> Iterator[FakeRenderer]:
        yield renderer

    for module in (renders, bench_hard):
        monkeypatch.setattr(module, "opened", opened)
    yield renderer


def test_reference_is_continued_and_kept(tmp_path: Path, fake: FakeRenderer) -> None:
    first = reference_of(tmp_path, "ball", 8.0)
    assert len(fake.made) == 2
    assert np.allclose(first.picture, np.mean(fake.made))
    assert np.allclose(first.deviation, -0.5)
    assert np.array_equal(reference_of(tmp_path, "ball", 8.0).picture, first.picture)
    assert len(fake.made) == 2
    longer = reference_of(tmp_path, "ball", 20.0)
    assert len(set(fake.made)) == len(fake.made) == 4
    assert np.allclose(longer.picture, np.mean(fake.made))


def test_kept_rounds_are_not_rendered_again(
    tmp_path: Path, fake: FakeRenderer, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["bench_hard", f"--out={tmp_path}", "--scenes=ball", "--contestants=off,caustics", "--seconds=4"]
    counts = []
    for more in (["--rounds=1"], ["--rounds=2"], ["--rounds=2"], ["--rounds=2", "--again"], ["--rounds=2", "--seconds=3"]):
        monkeypatch.setattr("sys.argv", [*command, *more])
        fake.made.clear()
        assert bench_hard.main() == 0
        counts.append(len([seed for seed in fake.made if seed < 100]))
    assert counts == [2, 2, 0, 4, 4]
    assert "| `off` |" in capsys.readouterr().out
    assert (tmp_path / "hard.md").exists()


def test_unknown_names_are_error_messages(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    for option, words in (("--scenes=door,barn", "no scene barn"), ("--contestants=off,luxor", "no contestant luxor")):
        monkeypatch.setattr("sys.argv", ["bench_hard", option])
        with pytest.raises(SystemExit):
            bench_hard.main()
        assert words in capsys.readouterr().err
