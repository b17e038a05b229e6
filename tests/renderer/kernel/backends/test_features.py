"""Tests that the path pool and the single-path integrator ("backends") render bit-identical films, for each feature in turn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer import render
from renderer.film import ALBEDO, CHANNELS, COLOR, SAMPLES, Sums
from renderer.kernel import accumulate
from renderer.render import RenderStats, render_frame, variant_for
from tests.grids import grid
from tests.renderer.kernel.backends.features import CAUSTICS, FEATURES, SPECTRAL, made

SPP = 4
# For these features the single-path kernel is compiled again, which takes longer than all others together. Their pictures from
# the pool are compared with closed forms and averages over time in tests/renderer/test_motion_blur.py, and with closed forms in
# tests/renderer/test_media.py.
MOVING = (
    *("what moves", "textures that slide", "lights that turn with their pictures", "a camera that moves"),
    *("a lens that distorts", "a fisheye", "a rolling shutter"),
)
MOVING_MEDIA = "fog in a room that the camera moves in"
EVERYTHING = "fog that moves"
MEDIA = (
    *("fog", "smoke around the camera", "cards in fog", "few of anything in smoke", "milk in glass", "rough glass in haze"),
    *("wax", "skin", MOVING_MEDIA, EVERYTHING, "lamps in thick fog", "smoke in a grid", "fire in a grid behind cards"),
)
# For these distances are sampled towards small lamps.
LIT_MEDIA = ("cards in fog", "rough glass in haze", "lamps in thick fog")
GRIDS = ("smoke in a grid", "fire in a grid behind cards")
# For these the kernels of targets are compiled.
AIMED = (
    *("lamps in glass", "lamps in glass by metal and plastic", "lamps in glass by a coat on bumps"),
    *("lamps in glass by rough glass", "lamps in glass by a pane", "lamps in glass by a brushed metal"),
    *("lamps in glass, with few bounces", "lamps in glass, without splitting"),
)
AIMED_IN_MEDIA = ("lamps in glass in fog", "lamps in glass by wax")
# For these the kernels of hair, of light links and of visibility by kind of ray are compiled.
HAIR = ("hair", "hair in fog", "hair of facets", "hair of facets in fog")
LINKED = ("linked lights", "linked lights through cards", "linked lights in fog", "linked lights on wax")
BY_KIND = ("seen by some rays", "seen by some rays, through cards", "seen by some rays, in fog")
CAUGHT = ("reflections on a floor", "reflections without shadows", "reflections in fog")
RARE = MOVING + MEDIA + AIMED + AIMED_IN_MEDIA + HAIR + LINKED + BY_KIND + CAUGHT


def _rendered(name: str, monkeypatch: pytest.MonkeyPatch | None, spectral: str = "off") -> tuple[Sums, RenderStats]:
    """Returns the film rendered by the pool or, given a monkeypatch, by the single-path kernel with all features."""
    scene, settings = made(name)
    settings = replace(settings, spectral=spectral)
    stats = RenderStats()
    if monkeypatch is None:
        return render_frame(scene, settings, SPP, stats=stats), stats
    with monkeypatch.context() as patched:
        patched.setattr(render, "renderer_of", lambda *_: accumulate._render_special_path)
        patched.setattr(render, "has_variants", lambda _: False)
        return render_frame(scene, settings, SPP, stats=stats), stats


@grid("name", FEATURES, ordinary=[name for name in FEATURES if name not in RARE])
def test_a_feature_has_the_same_bits_in_both_backends(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    (pool, of_pool), (one, of_one) = _rendered(name, None), _rendered(name, monkeypatch)
    planes, *pixel = np.nonzero(pool != one)
    differ = len(set(zip(*pixel, strict=True)))
    assert differ == 0, f"{differ} pixels differ, in the planes {sorted(set(planes.tolist()))}"
    assert of_pool.rays == of_one.rays
    assert (pool[SAMPLES] == SPP).all()
    assert pool[COLOR].any() == (name != "no light")


@pytest.mark.long
@pytest.mark.parametrize("name", SPECTRAL)
def test_spectra_have_the_same_bits_in_both_backends(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pool, one = (_rendered(name, patch, "on")[0] for patch in (None, monkeypatch))
    np.testing.assert_array_equal(pool, one)
    in_rgb, _ = _rendered(name, None)
    assert (pool[SAMPLES] == SPP).all()
    assert (pool[COLOR] != in_rgb[COLOR]).any()
    if name not in GRIDS:  # where flights, which end at first hits, have wavelengths
        first_hits = slice(ALBEDO.start, CHANNELS)
        np.testing.assert_array_equal(pool[first_hits], in_rgb[first_hits])


@pytest.mark.long
@pytest.mark.parametrize("name", CAUSTICS)
def test_light_through_casters_has_the_same_bits_in_both_backends(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    (pool, of_pool), (one, of_one) = _rendered(name, None), _rendered(name, monkeypatch)
    np.testing.assert_array_equal(pool, one)
    assert of_pool.rays == of_one.rays
    assert (pool[SAMPLES] == SPP).all()
    scene, settings = made(name)
    off = render_frame(scene, replace(settings, caustics="off"), SPP)
    assert (pool[COLOR] != off[COLOR]).any()
    first_hits = slice(ALBEDO.start, CHANNELS)
    np.testing.assert_array_equal(pool[first_hits], off[first_hits])


def test_the_features_ask_for_all_variants() -> None:
    """The features require all kernel variants; otherwise the tests above would not cover them all."""
    names = list(FEATURES)
    full, moving, media = names.index("textures"), names.index(MOVING[0]), names.index(MEDIA[0])
    for k, name in enumerate(names):
        scene, settings = made(name)
        variant = "media" if k >= media else "moving" if k >= moving else "full" if k >= full else "plain"
        variant = "moving-media" if name == MOVING_MEDIA else "lit-media" if name in LIT_MEDIA else variant
        variant = "grids" if name in GRIDS else variant
        variant = "aimed" if name in AIMED else "complete" if name in (EVERYTHING, *AIMED_IN_MEDIA) else variant
        variant = "linked" if name in LINKED else variant
        variant = "visibility" if name in BY_KIND else variant
        variant = "catchers" if name in CAUGHT else variant
        variant = {"hair": "hair", "hair in fog": "moving-hair", "reflections in fog": "moving-catchers"}.get(name, variant)
        variant = {"hair of facets": "huang", "hair of facets in fog": "moving-huang"}.get(name, variant)
        assert variant_for(settings, scene) == variant, name
