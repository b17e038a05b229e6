"""Tests of a slot with a graphics card: it renders with the card, or with the processor if the card cannot."""

from __future__ import annotations

import logging
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from protocol.contract import RenderBatch
from renderer.cuda.driver import Card
from renderer.cuda.render import CardError, CardMemoryError
from renderer.settings import RenderSettings, Tile, View
from worker.work import slot_card

CARDS = (Card(0, "first", (7, 0), 1 << 30, 1), Card(3, "second", (8, 6), 1 << 30, 1))
BATCH = RenderBatch("b", "job", 0, "0" * 64, Tile(0, 0, 8, 8), 0, 2, RenderSettings(8, 8, View((0, 0, 4), (0, 0, 0))))


class Renderer:
    """A card's renderer that records loaded scenes; `Renderer.answer` replaces render_batch."""

    answer: Any = "sums"

    def __init__(self, card: Card) -> None:
        self.card = card
        self.loaded: set[str] = set()

    def has(self, variant: str) -> bool:
        return variant in self.loaded

    def load(self, variant: str, fetch: Any) -> None:
        fetch(f"cuda-{variant}")
        self.loaded.add(variant)


@pytest.fixture
def worker(monkeypatch: pytest.MonkeyPatch) -> Any:
    def rendered(*arguments: Any) -> Any:
        if isinstance(Renderer.answer, Exception):
            raise Renderer.answer
        return Renderer.answer

    monkeypatch.setattr(slot_card, "CardRenderer", Renderer)
    monkeypatch.setattr(slot_card, "render_batch", rendered)
    monkeypatch.setattr(slot_card, "fetch_kernel", lambda link, folder, name: (True, f"{name} fetched"))
    monkeypatch.setattr(slot_card, "slot", lambda: 2)
    monkeypatch.setattr(slot_card, "_cards", {})
    monkeypatch.setattr(slot_card, "_too_large", set())
    monkeypatch.setattr(Renderer, "answer", "sums")
    return SimpleNamespace(name="w", slots=4, cards=CARDS, link=object())


def render(worker: Any, batch: RenderBatch = BATCH) -> tuple[Any, list[bool]]:
    compiling: list[bool] = []
    scene: Any = SimpleNamespace()
    return slot_card.render_with_card(worker, batch, scene, "plain", compiling.append), compiling


def test_the_last_slots_have_a_card_each(worker: Any) -> None:
    assert [slot_card.card_of(worker, number) for number in range(5)] == [None, None, *CARDS, None]
    worker.slots = 2
    assert [slot_card.card_of(worker, number) for number in range(2)] == list(CARDS)
    worker.cards = ()
    assert slot_card.card_of(worker, 0) is None


def test_a_batch_is_rendered_and_its_kernel_loaded_once(worker: Any) -> None:
    (sums, seconds), compiling = render(worker)
    assert (sums, compiling) == ("sums", [True, False])
    assert seconds >= 0
    assert render(worker)[1] == []


def test_what_a_card_lacks_is_left_to_the_processor(worker: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    assert render(worker, replace(BATCH, settings=replace(BATCH.settings, integrator="ao")))[0] is None
    monkeypatch.setattr(slot_card, "slot", lambda: 0)
    assert render(worker)[0] is None


def test_a_scene_that_does_not_fit_is_left_to_the_processor_and_others_are_not(worker: Any, caplog: Any) -> None:
    Renderer.answer = CardMemoryError("card 0 (first) has too little memory, 1 GiB, for this scene")
    with caplog.at_level(logging.WARNING, "worker"):
        assert render(worker)[0] is None
    assert caplog.messages == ["card 0 (first) has too little memory, 1 GiB, for this scene; the processor renders it"]
    Renderer.answer = "sums"
    assert render(worker)[0] is None
    assert render(worker, replace(BATCH, compiled="1" * 64))[0] is not None


def test_a_card_that_fails_is_not_used_again(worker: Any, caplog: Any) -> None:
    Renderer.answer = CardError("card 0 (first): cuLaunchKernel failed")
    with caplog.at_level(logging.WARNING, "worker"):
        assert render(worker)[0] is None
    assert "from now on the processor renders" in caplog.text
    Renderer.answer = "sums"
    assert render(worker)[0] is None
