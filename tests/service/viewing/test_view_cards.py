"""Tests of the choice of graphics cards for live views, and of the pieces that are sent to them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from protocol.contract import WorkerReport
from renderer.settings import RenderSettings, View
from service.scheduling.fleet.workers import WorkerSnapshot
from service.viewing import view_cards
from service.viewing.passes import CARD_MESSAGE_TARGET_S, UNMEASURED_PIECES, Passes, levels_of
from service.viewing.pending import PendingMessage
from service.viewing.view_cards import ViewCards

SETTINGS = RenderSettings(960, 540, View((0.0, 0.0, 4.0), (0.0, 0.0, 0.0)))
REQUEST: Any = SimpleNamespace(upload="scene", settings=SETTINGS)
CPU_S, CARD_S = 2e-6, 2e-8


def session_of(**more: Any) -> Any:
    about = {"kind": "k", "settings": SETTINGS, "compiled": "c", "request": REQUEST, "has_picture": False, "samples": 0}
    return SimpleNamespace(**{**about, **more})


def report(name: str, **more: Any) -> WorkerReport:
    return WorkerReport(name, "host", 1, 1, "cpu", "k", "ready", 0.0, has_card_queue=True, **more)


@pytest.fixture
def cards() -> ViewCards:
    reports = {"old": report("old"), "card": report("card", views_on_cards=True)}
    return ViewCards(SimpleNamespace(roster=WorkerSnapshot(reports=reports)))  # type: ignore[arg-type]


def free(cards: ViewCards, session: Any, out: list[PendingMessage], shared: tuple[str, ...] = (), has_cpu: bool = True) -> bool:
    found = cards.free(session, out, shared, has_cpu)
    assert found is None or found.name == "card"
    return found is not None


def test_card_has_one_message_until_its_speed_is_known_and_then_two(cards: ViewCards) -> None:
    session = session_of()
    out = [PendingMessage(session, 1, "k", card="card")]
    assert free(cards, session, [])
    assert not free(cards, session, out)
    cards.update(REQUEST, "card", CARD_S)
    assert free(cards, session, out)
    assert not free(cards, session, out * 2)
    assert free(cards, session, out, shared=("card",)), "a view without a picture does not share the slot with batches"
    assert not free(cards, session_of(samples=1), out, shared=("card",))
    out[0].is_declined = True
    assert not free(cards, session, out), "its slot loads the scene"


def test_card_that_does_not_begin_gets_no_first_pictures(cards: ViewCards, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr(view_cards, "time", SimpleNamespace(monotonic=lambda: now[0]))
    out = PendingMessage(session_of(), 1, "k", card="card", last_seen=100.0)
    now[0] += 0.1
    assert not cards.is_late(out)
    now[0] += 0.1
    assert cards.is_late(out)
    assert not cards.is_late(replace(out, has_started=True))
    assert not cards.is_late(replace(out, card=""))
    cards.update(REQUEST, "card", CARD_S)
    assert cards.rate(REQUEST, "k", "c", SETTINGS) == pytest.approx(1 / CARD_S)
    cards.set_busy("card")
    assert cards.rate(REQUEST, "k", "c", SETTINGS) == 0
    assert not free(cards, session_of(), [])
    assert free(cards, session_of(), [], has_cpu=False)
    assert free(cards, session_of(has_picture=True), [])
    cards.record_answer("card", has_begun=True)
    assert free(cards, session_of(), [])
    assert not cards.is_late(out)


def test_refusals_are_of_scene_and_settings(cards: ViewCards, monkeypatch: pytest.MonkeyPatch) -> None:
    cards.refuse("card", session_of())
    assert not free(cards, session_of(), [])
    assert not free(cards, session_of(settings=replace(SETTINGS, width=64, seed=3, view=View((1, 1, 1), (0, 0, 0)))), [])
    assert free(cards, session_of(settings=replace(SETTINGS, max_depth=3)), [])
    assert free(cards, session_of(compiled="d"), [])
    monkeypatch.setattr(view_cards, "REFUSAL_S", -1.0)
    cards.refuse("card", session_of())
    assert free(cards, session_of(), [])


def test_message_for_a_card_is_large() -> None:
    levels = levels_of(960, 540, 16, CPU_S, 2)
    with_card = levels_of(960, 540, 16, CPU_S, 2, 1 / CARD_S)
    assert [len(levels), len(with_card)] == [2, 1], "the first picture of a card is the whole view"
    passes = Passes(levels, CPU_S)
    first = passes.next_card_message(CARD_S)
    assert [piece.tile for piece in first] == list(range(len(levels[0].tiles))), "the whole first picture"
    whole = passes.next_card_message(CARD_S)
    seconds = sum(levels[1].tiles[piece.tile].w * levels[1].tiles[piece.tile].h * piece.count * CARD_S for piece in whole)
    assert seconds == pytest.approx(CARD_MESSAGE_TARGET_S, rel=0.05)
    assert len(passes.next_card_message(None)) == UNMEASURED_PIECES
    rest = [piece for _ in range(10000) for piece in passes.next_card_message(CARD_S)]
    assert rest[-1].first + rest[-1].count == 16
    assert len({*first, *whole, *rest}) == len(first) + len(whole) + len(rest)


def test_drafts_go_to_idle_cards_that_make_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """A draft's cost is that of pieces until a draft was measured; the slowest card counts."""
    reports = {"old": report("old", views_on_cards=True)}
    cards = ViewCards(SimpleNamespace(roster=WorkerSnapshot(reports=reports)))  # type: ignore[arg-type]
    cards.update(REQUEST, "old", CARD_S)
    session = session_of()
    assert cards.draft_cost_s(REQUEST, "k", "c", SETTINGS) is None
    assert cards.free(session, [], [], True, drafts=True) is None
    for name in ("one", "two"):
        reports[name] = report(name, views_on_cards=True, drafts_views=True)
    cards = ViewCards(SimpleNamespace(roster=WorkerSnapshot(reports=reports)))  # type: ignore[arg-type]
    assert cards.draft_cost_s(REQUEST, "k", "c", SETTINGS) is None, "no card has rendered the scene"
    cards.update(REQUEST, "one", CARD_S)
    cards.update(REQUEST, "two", 2 * CARD_S)
    assert cards.draft_cost_s(REQUEST, "k", "c", SETTINGS) == 2 * CARD_S
    cards.update_draft(REQUEST, "two", CARD_S / 2)
    assert cards.draft_cost_s(REQUEST, "k", "c", SETTINGS) == CARD_S
    found = cards.free(session, [], [], True, drafts=True)
    assert found is not None and found.name == "one", "and not the one of an earlier release"
    cards.set_busy("one")
    assert cards.draft_cost_s(REQUEST, "k", "c", SETTINGS) == CARD_S / 2
