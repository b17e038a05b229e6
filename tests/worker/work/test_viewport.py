"""Tests of views: those that must not wait for a kernel to be compiled, and the speed that they report."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from protocol.view_parts import Part, ViewParts
from renderer.settings import RenderSettings, Tile, View
from worker.exchange import ready
from worker.work import viewport

SETTINGS = RenderSettings(8, 8, View((0, 0, 5), (0, 0, 0)))


def test_view_that_needs_a_kernel_is_declined_without_one(monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[str] = []
    answers = SimpleNamespace(is_wanted=lambda: True, send=lambda type, *_, **__: sent.append(type))
    monkeypatch.setattr(viewport, "ViewAnswers", lambda worker, work: answers)
    monkeypatch.setattr(viewport, "mapped_scene", lambda worker, sha256: None)
    monkeypatch.setattr(viewport, "variant_for", lambda settings, scene: "plain")
    monkeypatch.setattr(viewport, "has_kernels", lambda link, settings, variant: False)
    monkeypatch.setattr(viewport, "make_kernel_ready", lambda *_: pytest.fail("it compiles"))
    sought = ViewParts("m", "w", 1, "0" * 64, SETTINGS, [Part(0, Tile(0, 0, 8, 8), 0, 1)], needs_kernel=True)
    work = ViewParts.from_json(sought.to_json())
    worker: Any = SimpleNamespace(link=None, name="w")
    assert viewport.render_view(worker, work, lambda is_compiling: None) == 0.0
    assert sent == ["begun", "declined"]


def test_first_hits_are_not_reported_as_samples_per_second(monkeypatch: pytest.MonkeyPatch) -> None:
    """They are a few times as fast as whole paths, and the page forecasts the time of a picture by the speed."""
    answers = SimpleNamespace(is_wanted=lambda: True, send=lambda *_, **__: None)
    monkeypatch.setattr(viewport, "ViewAnswers", lambda worker, work: answers)
    monkeypatch.setattr(viewport, "mapped_scene", lambda worker, sha256: None)
    monkeypatch.setattr(viewport, "variant_for", lambda settings, scene: "plain")
    monkeypatch.setattr(viewport, "settings_as_rendered", lambda settings, *_: settings)
    monkeypatch.setattr(viewport, "is_warm", lambda *_: True)
    monkeypatch.setattr(viewport, "render_batch", lambda *_: SimpleNamespace(sums=None))
    monkeypatch.setattr(viewport, "pack_view_sums", lambda sums, work: b"")
    worker: Any = SimpleNamespace(link=None, name="w")

    def speed(max_depth: int, has_guides: bool) -> float:
        settings = replace(SETTINGS, max_depth=max_depth)
        work = ViewParts("m", "w", 1, "0" * 64, settings, [Part(0, Tile(0, 0, 8, 8), 0, 1)], has_guides=has_guides)
        return viewport.render_view(worker, work, lambda is_compiling: None)

    assert speed(12, has_guides=True) > 0.0
    assert speed(1, has_guides=False) > 0.0, "a picture of depth 1"
    assert speed(1, has_guides=True) == 0.0


def test_kernel_is_at_hand_if_machine_or_farm_has_it(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    cached, farms = {"here"}, {"there"}
    link: Any = None
    monkeypatch.setattr(ready.jit, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(ready.jit, "is_cached", cached.__contains__)
    monkeypatch.setattr(ready, "copy_shipped_kernels", lambda folder: None)
    monkeypatch.setattr(ready, "kernel_name", lambda settings, variant: variant)
    monkeypatch.setattr(ready, "fetch_kernel", lambda link, folder, name: (name in farms, "a sentence"))
    assert [ready.has_kernels(link, SETTINGS, name) for name in ("here", "there", "nowhere")] == [True, True, False]
    monkeypatch.setattr(ready, "samples_guide", lambda settings: True)
    monkeypatch.setattr(ready, "pilot_kernel_name", lambda variant: "a pilot")
    assert not ready.has_kernels(link, SETTINGS, "here"), "its path guide has no kernel"
