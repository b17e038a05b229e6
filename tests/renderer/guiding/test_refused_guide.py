"""Tests of images whose paths follow no guide: the kernel without guides renders them, on processors and cards."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from renderer import render
from renderer.arrays.guide import Guide, empty_guide
from renderer.arrays.kernel_variant import strip_absent_features
from renderer.film import CHANNELS, SAMPLES
from renderer.guiding import train
from renderer.render import guide_of, kernel_name, render_frame, settings_as_rendered, variant_for
from renderer.scene.compiled import CompiledScene
from renderer.scene.description import Material
from renderer.settings import Tile
from tests.renderer.builders import emitter, gray, scene, settings, square

LIT = scene(
    [Material(base_color=gray(0.7)), emitter(4.0)],
    (square((0, 0, 0), (4, 0, 0), (0, 0, -4), 0), square((0, 3, 0), (1, 0, 0), (0, 0, 1), 1)),
)
AUTO = replace(settings((0, 1, 4), (0, 0, 0)), width=16, height=16, guiding="auto")


@pytest.fixture
def guides(monkeypatch: pytest.MonkeyPatch) -> list[Guide | None]:
    """Returns a list to which the guide of each rendered batch is added. No guide is kept from before."""
    found: list[Guide | None] = []
    render_with_kernel = render._render

    def spied(prepared: CompiledScene, *more: Any) -> Any:
        found.append(prepared.path_guide)
        return render_with_kernel(prepared, *more)

    monkeypatch.setattr(render, "_render", spied)
    monkeypatch.setattr(train, "_kept", [])
    return found


def _refuse(monkeypatch: pytest.MonkeyPatch) -> list[CompiledScene]:
    """Replaces the training, which refuses; returns a list to which the scene of each training is added."""
    trained: list[CompiledScene] = []
    monkeypatch.setattr(render, "train_guide", lambda prepared, _: trained.append(prepared))
    monkeypatch.setattr(render, "is_pilot_warm", lambda _: True)
    return trained


def test_kernel_without_guides_renders_after_a_refusal(guides: list[Guide | None], monkeypatch: pytest.MonkeyPatch) -> None:
    trained = _refuse(monkeypatch)
    first = render_frame(LIT, AUTO, 2)
    again = render_frame(LIT, replace(AUTO, cryptomatte=2), 2)
    assert len(trained) == 1, "Cryptomatte changes nothing about a guide"
    off = render_frame(LIT, replace(AUTO, guiding="off"), 2)
    assert np.array_equal(first, off) and np.array_equal(again, off)
    assert guides and all(guide is None for guide in guides)
    assert settings_as_rendered(AUTO, LIT) == replace(AUTO, guiding="off") and len(trained) == 1
    assert "guided" not in kernel_name(settings_as_rendered(AUTO, LIT), variant_for(AUTO, LIT))
    assert "guided" in kernel_name(AUTO, variant_for(AUTO, LIT))


def test_guide_of_another_process_is_not_trained_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(train, "_kept", [])
    trained: list[None] = []
    for seed, guide in enumerate((None, empty_guide())):
        asked = replace(AUTO, seed=seed)
        assert not train.is_guide_kept(LIT, asked)
        train.keep_guide(LIT, asked, guide)
        assert train.is_guide_kept(LIT, replace(asked, deep=8)), "deep pixels change nothing about a guide"
        assert train.kept_guide(LIT, asked, lambda: trained.append(None)) is guide
    assert not trained
    train.kept_guide(LIT, replace(AUTO, seed=7), lambda: trained.append(None))
    assert len(trained) == 1, "another image has another guide"


def test_image_with_catchers_has_another_guide(monkeypatch: pytest.MonkeyPatch) -> None:
    """Light samples of the sky are for catchers before a transparent background only, so pilot paths differ."""
    monkeypatch.setattr(train, "_kept", [])
    trained = _refuse(monkeypatch)
    catching = scene(
        [Material(base_color=gray(0.7), shadow_catcher=True)],
        (square((0, 0, 0), (4, 0, 0), (0, 0, -4), 0),),
        environment=1.0,
    )
    transparent = replace(AUTO, background="transparent")
    for asked in (AUTO, transparent, AUTO, transparent):
        guide_of(asked, catching)
    assert [bool(each.environment_frame[3] > 0) for each in trained] == [False, True]


@pytest.mark.parametrize(("guide", "name"), [(None, "plain"), (empty_guide(), "plain-guided")])
def test_cards_load_the_kernel_that_renders(guide: Guide | None, name: str) -> None:
    launched: list[tuple[str, Guide | None]] = []

    def launch(prepared: CompiledScene, variant: str, *_: Any) -> Any:
        launched.append((variant, prepared.path_guide))
        sums = np.zeros((CHANNELS, 16, 16), np.int64)
        sums[SAMPLES] = 1
        return SimpleNamespace(sums=sums, bad_count=0, rays=0, records=np.zeros((0, 2), np.uint32))

    prepared = strip_absent_features(LIT, "plain")._replace(path_guide=guide)
    card: Any = SimpleNamespace(render=launch)
    render._render_on(card, prepared, AUTO, Tile(0, 0, 16, 16), 0, 1)
    assert launched == [(name, guide)]


@pytest.mark.long
def test_lit_scene_is_refused_after_a_few_paths(guides: list[Guide | None]) -> None:
    for _ in range(2):
        assert np.array_equal(render_frame(LIT, AUTO, 2), render_frame(LIT, replace(AUTO, guiding="off"), 2))
    assert guides and all(guide is None for guide in guides)
    assert [guide for _, _, guide in train._kept] == [None]
