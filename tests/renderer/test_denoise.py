"""Tests of denoising by Open Image Denoise: lower error, edges preserved by the guides, the raw picture unchanged."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from renderer import denoise, film
from renderer.arrays import rows
from renderer.denoise import is_available
from renderer.denoise_guides import denoise_still, guide_kernel, guiding_albedo
from renderer.errors import SettingsError
from renderer.image.tonemap import apply
from renderer.render import kernel_name, render_frame, variant_for
from renderer.scene.compile import compile_scene, summarise
from renderer.scene.description import Environment, Instance, Material, SceneDescription, Sphere
from renderer.scene.load import read
from renderer.settings import RenderSettings, View
from tests.renderer.builders import gray, square

pytestmark = pytest.mark.skipif(not is_available(), reason="Open Image Denoise is not installed")

SCENES = Path(__file__).resolve().parents[2] / "scenes"
SEEDS = range(1, 7)
SIZE = 64


def rmse(a, b, where):
    # Relative error, as the eye perceives it: otherwise the lamp's radiance would dominate.
    return float(np.sqrt(np.square((a - b) / (0.1 + b))[where].mean()))


@pytest.fixture(scope="module")
def rendered():
    """Returns a function `rendered(seed, spp)` that renders the Cornell box as (color, albedo, normal)."""
    description = read(SCENES, "cornell-box.yaml")
    scene = compile_scene(description)
    view = View.from_json(summarise(description, scene)["cameras"][0]["view"])

    def render(seed, spp):
        settings = RenderSettings(SIZE, SIZE, view, seed=seed, max_depth=6)
        sums = render_frame(scene, settings, spp)
        return [film.mean(sums, settings.film_exponent, channel) for channel in (film.COLOR, film.ALBEDO, film.NORMAL)]

    return render


@pytest.fixture(scope="module")
def pictures(rendered):
    """Returns (reference, [pictures of 16 samples, one per seed])."""
    return rendered(0, 1024), [rendered(seed, 16) for seed in SEEDS]


def edges_of(albedo, normal):
    """Returns a mask of the pixels next to a change of albedo or normal."""
    guide = np.concatenate([albedo, normal], axis=-1)
    found = np.zeros(guide.shape[:2], bool)
    for axis in (0, 1):
        jump = np.abs(np.diff(guide, axis=axis)).max(axis=-1) > 0.3
        found |= np.pad(jump, [(0, 1), (0, 0)] if axis == 0 else [(0, 0), (0, 1)])
        found |= np.pad(jump, [(1, 0), (0, 0)] if axis == 0 else [(0, 0), (1, 0)])
    return found


@pytest.mark.long
def test_denoising_reduces_the_error_and_keeps_edges(pictures):
    (reference, albedo, normal), noisy = pictures
    edges = edges_of(albedo, normal)
    assert 0.05 < edges.mean() < 0.5
    nothing = np.zeros_like(albedo)
    gains, at_edges, by_guides = [], [], []
    for color, own_albedo, own_normal in noisy:
        clean = denoise.denoise(color, own_albedo, own_normal)
        gains.append(np.log(rmse(clean, reference, ~edges) / rmse(color, reference, ~edges)))
        at_edges.append(np.log(rmse(clean, reference, edges) / rmse(color, reference, edges)))
        blind = denoise.denoise(color, nothing, nothing)
        by_guides.append(np.log(rmse(clean, reference, edges) / rmse(blind, reference, edges)))
    for ratios in (gains, at_edges, by_guides):
        standard_error = np.std(ratios, ddof=1) / np.sqrt(len(ratios))
        assert np.mean(ratios) + 3 * standard_error < 0, ratios


@pytest.mark.long
def test_preview_denoising_reduces_the_error(pictures):
    reference, noisy = pictures[0][0], pictures[1]
    everywhere = np.ones(reference.shape[:2], bool)
    clean = [rmse(denoise.denoise_preview(*inputs), reference, everywhere) for inputs in noisy]
    ratios = np.log(clean) - np.log([rmse(inputs[0], reference, everywhere) for inputs in noisy])
    assert ratios.mean() + 3 * ratios.std(ddof=1) / np.sqrt(len(ratios)) < 0, ratios


@pytest.mark.long
def test_guides_of_enough_samples_are_taken_as_clean(pictures):
    """Away from edges the error is lower than with the same guides taken as noisy, and at edges it is about the same."""
    (reference, albedo, normal), noisy = pictures
    edges = edges_of(albedo, normal)
    for where, bound in ((~edges, 0.0), (edges, np.log(1.05))):
        ratios = []
        for inputs in noisy:
            quick, clean = (denoise.denoise_fast(*inputs, has_clean_guides=is_clean) for is_clean in (False, True))
            ratios.append(np.log(rmse(clean, reference, where) / rmse(quick, reference, where)))
        assert np.mean(ratios) + 3 * np.std(ratios, ddof=1) / np.sqrt(len(ratios)) < bound, np.exp(ratios)


def test_denoising_is_deterministic_and_keeps_its_inputs(rendered):
    inputs = rendered(1, 16)
    copies = [image.copy() for image in inputs]
    first = denoise.denoise(*inputs, threads=1)
    for image, copy in zip(inputs, copies, strict=True):
        np.testing.assert_array_equal(image, copy)
    assert (first.dtype, first.shape, first.flags.c_contiguous) == (np.float32, (SIZE, SIZE, 3), True)
    np.testing.assert_array_equal(first, denoise.denoise(*inputs, threads=1))


@pytest.mark.long
def test_denoising_keeps_high_dynamic_range(pictures):
    color, albedo, normal = pictures[1][0]
    bright = denoise.denoise(color * 1000, albedo, normal)
    usual = denoise.denoise(color, albedo, normal)
    assert usual.max() > 1.5, "the lamp is brighter than white"
    assert np.median(np.abs(bright / 1000 - usual) / (usual + 1e-3)) < 0.02
    black = np.zeros((3, 5, 3), np.float32)
    assert not apply(denoise.denoise(black, black, black)).any(), "nothing that a screen shows"


def test_missing_denoiser_is_an_error_message(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyoidn", None)
    black = np.zeros((3, 5, 3), np.float32)
    with pytest.raises(SettingsError, match="pip install"):
        denoise.denoise(black, black, black)
    assert denoise.denoise_preview(black, black, black) is black


def mirrored(*, has_mirror: bool = True, tiles: int = 0):
    """Returns a room with a mirror for its back wall and a glossy silver ball, or with a grey wall in place of the mirror.

    tiles: of the red wall behind the camera that are white, in each direction.
    """
    back = Material(kind="mirror", base_color=gray(0.9)) if has_mirror else Material(base_color=gray(0.9))
    walls = [square((0, 0, 0), (3, 0, 0), (0, 0, -3), 0), square((0, 1, -3), (3, 0, 0), (0, 1, 0), 1)]
    behind, lamp = square((0, 1, 6), (3, 0, 0), (0, -1, 0), 2), square((0, 4, 0), (0.5, 0, 0), (0, 0, 0.5), 3)
    red, shine = Material(base_color=(0.7, 0.1, 0.2)), Material(base_color=gray(0.0), emission=gray(20.0))
    silver = Material(kind="metallic_roughness", base_color=gray(0.8), metallic=1.0 if has_mirror else 0.0, roughness=0.1)
    white = [
        square((0.6 * (x - tiles / 2), 0.3 * y, 5.99), (0.15, 0, 0), (0, -0.15, 0), 0) for x in range(tiles) for y in range(tiles)
    ]
    return compile_scene(
        SceneDescription(
            meshes=[*walls, behind, lamp, *white],
            instances=[Instance(k) for k in range(4 + len(white))],
            spheres=[Sphere((1.0, 0.5, -1.0), 0.5, 4)],
            materials=[Material(base_color=(0.2, 0.5, 0.3)), back, red, shine, silver],
            environment=Environment(gray(0.2)),
        )
    )


VIEW = View((0.0, 1.0, 5.0), (0.0, 0.8, 0.0), fov=40.0)


def test_the_guide_is_the_albedo_behind_mirrors():
    """The mirror has the wall's red times its reflectance; pixels without specular surfaces have the film's albedo."""
    scene, settings = mirrored(), RenderSettings(32, 24, VIEW, environment=(1.0, 1.0, 1.0))
    sums = render_frame(scene, settings, 4)
    albedo = film.mean(sums, 24, film.ALBEDO)
    guide = guiding_albedo(scene, settings, albedo)
    np.testing.assert_array_equal(guide[-4:], albedo[-4:])  # the floor
    assert (guide != albedo).any(axis=-1).mean() > 0.2
    in_mirror = np.isclose(guide, 0.9 * np.array([0.7, 0.1, 0.2]), rtol=0.01).all(axis=-1)
    assert in_mirror.mean() > 0.02
    np.testing.assert_allclose(albedo[in_mirror], 0.9, rtol=1e-3)
    plain = mirrored(has_mirror=False)
    assert guiding_albedo(plain, settings, albedo) is albedo
    assert guiding_albedo(scene, settings, albedo[:3]) is not guide


def test_the_guide_needs_no_kernel_but_that_of_the_frame():
    scene, plain = mirrored(), RenderSettings(8, 8, VIEW)
    frames = [
        plain,
        replace(plain, light_paths="on"),
        replace(plain, views=(VIEW, VIEW)),
        replace(plain, background="transparent"),
    ]
    kinds = np.int32([rows.MIRROR, rows.GLASS, rows.PLASTIC, rows.LAYERED, rows.DIFFUSE])
    for flags in (0, rows.TEXTURED, rows.REFLECTIONS | rows.CATCHES):
        changed = scene._replace(material_kind=kinds, material_flags=np.full(5, flags, np.int32))
        for settings in frames:
            assert kernel_name(*guide_kernel(changed, settings)) == kernel_name(settings, variant_for(settings, changed))
    assert guide_kernel(scene, replace(plain, integrator="ao")) is None


@pytest.mark.long
def test_the_guide_lowers_the_error_in_mirrors():
    scene, settings = mirrored(tiles=8), RenderSettings(96, 72, VIEW)
    color = film.mean(render_frame(scene, settings, 2048), 24)
    errors = {"first hits": 0.0, "guided": 0.0}
    for seed in SEEDS:
        noisy = replace(settings, seed=seed)
        sums = render_frame(scene, noisy, 8)
        planes = [film.mean(sums, 24, plane) for plane in (film.COLOR, film.ALBEDO, film.NORMAL)]
        everywhere = np.ones(color.shape[:2], bool)
        errors["first hits"] += rmse(denoise.denoise(*planes), color, everywhere)
        errors["guided"] += rmse(denoise_still(sums, scene, noisy), color, everywhere)
    assert errors["guided"] < 0.9 * errors["first hits"]


def test_cards_images_lie_in_its_memory(monkeypatch):
    """The way of the images to a card and back; the library's processor stands in for the card."""
    import pyoidn

    random = np.random.default_rng(0)
    images = [random.random((24, 32, 3)).astype(np.float32) for _ in range(3)]
    expected = denoise.denoise(*images, threads=1)
    monkeypatch.setenv(denoise.DEVICE_VARIABLE, "cuda")
    monkeypatch.setattr(pyoidn, "OIDN_DEVICE_TYPE_CUDA", pyoidn.OIDN_DEVICE_TYPE_CPU)
    monkeypatch.setattr(denoise, "_warn_once", lambda sentence: pytest.fail(sentence))
    np.testing.assert_allclose(denoise.denoise(*images, threads=1), expected, rtol=1e-5)


def test_processor_denoises_where_no_card_can(monkeypatch):
    import pyoidn

    images = [np.full((8, 8, 3), value, np.float32) for value in (0.5, 0.4, 1.0)]
    expected = denoise.denoise_fast(*images, threads=1)
    said = []
    monkeypatch.setenv(denoise.DEVICE_VARIABLE, "cuda")
    monkeypatch.setattr(pyoidn, "OIDN_DEVICE_TYPE_CUDA", 99)  # no machine has such a device
    monkeypatch.setattr(denoise, "_warn_once", said.append)
    assert (denoise.denoise_fast(*images, threads=1) == expected).all()
    assert len(said) == 1
    assert said[0].startswith("Open Image Denoise failed: ")
    assert said[0].endswith(". The processor denoises in the card's place")
    monkeypatch.setenv(denoise.DEVICE_VARIABLE, "tpu")
    with pytest.raises(SettingsError, match="RAYFARM_DENOISER is tpu; give cpu or cuda"):
        denoise.denoise_fast(*images, threads=1)
