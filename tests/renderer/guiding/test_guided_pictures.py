"""Tests of pictures by guided paths: their mean is that of unguided paths, and their bits depend on scene and settings alone."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from renderer import render
from renderer.arrays.guide import PORTAL_RADIUS
from renderer.errors import SettingsError
from renderer.film import SAMPLES, Sums
from renderer.guiding import train
from renderer.kernel import accumulate
from renderer.kernel.backends.cuda.wavefront import BAD, RAYS
from renderer.render import RenderStats, render_batch, render_frame
from renderer.scene.description import Material, Sphere
from renderer.settings import RenderSettings, Tile, View
from tests.renderer.builders import emitter, gray, scene, settings, square
from tests.renderer.cuda.test_kernels import of_cpu, run
from tests.renderer.judge import limit, mean_and_error
from tests.renderer.kernel.backends.features import FEATURES

MATERIALS = [
    Material(base_color=gray(0.7)),
    emitter(40.0),
    Material(kind="metallic_roughness", base_color=(0.8, 0.5, 0.3), metallic=0.3, roughness=0.4),
    Material(kind="conductor", eta=(0.2, 0.4, 1.4), k=(4.0, 2.4, 1.6), roughness=0.3),
    Material(kind="glass", base_color=gray(1.0), roughness=0.0),
]
# Two rooms of 4 x 4 x 4 with a slit in the wall between them; the lamp is in the farther one.
ROOMS = scene(
    MATERIALS,
    (
        square((0, 0, -2), (2, 0, 0), (0, 0, -4), 0),
        square((0, 4, -2), (2, 0, 0), (0, 0, 4), 0),
        square((-2, 2, -2), (0, 2, 0), (0, 0, 4), 0),
        square((2, 2, -2), (0, 2, 0), (0, 0, -4), 0),
        square((0, 2, 2), (-2, 0, 0), (0, 2, 0), 0),
        square((0, 2, -6), (2, 0, 0), (0, 2, 0), 0),
        square((-1.1, 2, -2), (0.9, 0, 0), (0, 2, 0), 0),
        square((1.1, 2, -2), (0.9, 0, 0), (0, 2, 0), 0),
        square((1.2, 3.9, -4), (0.4, 0, 0), (0, 0, 0.4), 1),
    ),
    (Sphere((-0.8, 0.5, 0.0), 0.5, 2), Sphere((0.8, 0.5, 0.3), 0.5, 3), Sphere((0.0, 0.4, 0.8), 0.4, 4)),
)
PICTURE = replace(settings((0, 2, 1.9), (0, 1, -2)), width=24, height=24, guiding="on", max_depth=12)
VIEW = View((0.2, 0.2, 1.0), (0.2, 0.2, 0.0))


@pytest.fixture(autouse=True, params=("portals", "histograms"))
def guide(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Trains a guide of one of the two kinds from few pilot paths; returns its kind."""
    monkeypatch.setattr(train, "MOST_LEFT_BY_PORTALS", math.inf if request.param == "portals" else 0.0)
    monkeypatch.setattr(train, "PORTAL_ROUNDS", (1 << 12, 1 << 14, 1 << 10))
    monkeypatch.setattr(train, "MOST_LIT", 1.0)
    monkeypatch.setattr(train, "ROUNDS", (1 << 12, 1 << 14))
    monkeypatch.setattr(train, "PHOTONS", 1 << 14)
    monkeypatch.setattr(train, "MOST_LEFT", 1.0)  # so few paths learn no shares: a half everywhere
    monkeypatch.setattr(train, "_kept", [])
    return str(request.param)


def _by_one_path(asked: RenderSettings, spp: int, monkeypatch: pytest.MonkeyPatch, stats: RenderStats) -> Sums:
    with monkeypatch.context() as patched:
        patched.setattr(render, "renderer_of", lambda *_: accumulate._render_special_path)
        patched.setattr(render, "has_variants", lambda _: False)
        return render_frame(ROOMS, asked, spp, stats=stats)


@pytest.mark.long
def test_the_mean_is_that_of_unguided_paths():
    asked = replace(PICTURE, sampler="independent")
    guided, error = mean_and_error(render_frame(ROOMS, asked, 1024))
    plain, its_error = mean_and_error(render_frame(ROOMS, replace(asked, guiding="off", seed=1), 4096))
    both = math.hypot(error, its_error)
    assert both < 0.01 * plain, "too noisy to judge"
    assert abs(guided - plain) < limit(1) * both, f"{guided} and {plain} +- {both}"


@pytest.mark.long
def test_both_backends_have_the_same_bits(guide: str, monkeypatch: pytest.MonkeyPatch):
    of_pool, of_one = RenderStats(), RenderStats()
    pool = render_frame(ROOMS, PICTURE, 4, stats=of_pool)
    prepared = render._prepared(ROOMS, PICTURE)
    learned = prepared.path_guide
    assert (learned.portal[:, PORTAL_RADIUS] if guide == "portals" else learned.cell[:, 1] > 0).any(), "nothing was learned"
    one = _by_one_path(PICTURE, 4, monkeypatch, of_one)
    assert np.array_equal(pool, one)
    assert of_pool.rays == of_one.rays
    assert (pool[SAMPLES] == 4).all()
    assert not np.array_equal(pool, render_frame(ROOMS, replace(PICTURE, guiding="off"), 4))


@pytest.mark.long
@pytest.mark.parametrize("name", ["rooms", "a coat and cloth", "lamps in glass by metal and plastic"])
def test_cards_have_the_same_bits(name: str, guide: str, monkeypatch: pytest.MonkeyPatch):
    """The card's kernels run on the processor, in the variants plain, full and aimed."""
    compiled, asked = (lambda: ROOMS, PICTURE) if name == "rooms" else FEATURES[name]
    monkeypatch.setitem(FEATURES, name, (compiled, replace(asked, guiding="on")))
    wave, (film, stats) = run(name), of_cpu(name)
    learned = wave.scene.path_guide
    assert len(learned.portal) > 0 if guide == "portals" else (learned.cell[:, 1] > 0).any()
    assert np.array_equal(wave.film, film)
    assert wave.counters[RAYS] == stats.rays
    assert wave.counters[BAD] == 0


@pytest.mark.long
def test_workers_and_batches_change_no_bit(monkeypatch: pytest.MonkeyPatch):
    whole = render_frame(ROOMS, PICTURE, 4, threads=2)
    parts = np.zeros_like(whole)
    for tile in (Tile(0, 0, 24, 10), Tile(0, 10, 24, 14)):
        for first, count in ((0, 1), (1, 3)):
            monkeypatch.setattr(train, "_kept", [])  # as in a process that has trained no guide yet
            sums = render_batch(ROOMS, PICTURE, tile, first, count).sums
            parts[:, tile.y : tile.y + tile.h, tile.x : tile.x + tile.w] += sums
    assert np.array_equal(whole, parts)


@pytest.mark.long
def test_auto_renders_as_on_or_as_off(guide: str, monkeypatch: pytest.MonkeyPatch):
    auto = replace(PICTURE, guiding="auto")
    for most, same in ((0.0, "off"), (2.0, "on")):
        monkeypatch.setattr(train, "MOST_LEFT", most)
        monkeypatch.setattr(train, "MOST_LEFT_BY_PORTALS", most if guide == "portals" else 0.0)
        monkeypatch.setattr(train, "_kept", [])
        assert np.array_equal(render_frame(ROOMS, auto, 4), render_frame(ROOMS, replace(auto, guiding=same), 4))


def test_what_guiding_is_not_combined_with():
    for guiding in ("auto", "on"):
        with pytest.raises(SettingsError, match="guiding cannot be combined with caustics"):
            RenderSettings(2, 2, VIEW, guiding=guiding, caustics="on")
