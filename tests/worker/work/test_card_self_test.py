"""Tests of the self-test before a worker uses graphics cards: which verdicts of earlier workers it believes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from renderer.cuda import verdicts
from renderer.cuda.driver import Card
from renderer.cuda.verdicts import Verdict, keep_verdict
from worker.work import card_self_test
from worker.work.card_self_test import check_cards, check_kernel

CARD = Card(0, "RTX Test", (8, 6), 8 << 30, 1, "01", "570")
LINK: Any = None


@pytest.fixture
def tested(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[str]:
    """Returns a list to which each tested kernel is added; all pass. The cache is a folder."""
    found: list[str] = []

    def run(card: Card, kernel: str) -> Verdict:
        found.append(kernel)
        keep_verdict(card, kernel, kernel, Verdict("", True))
        return Verdict("", True)

    monkeypatch.setattr(verdicts, "private_folder", lambda name: tmp_path / name)
    monkeypatch.setattr(card_self_test, "ptx_of", lambda kernel, fetch: kernel)
    monkeypatch.setattr(card_self_test, "fetch_or_compile", lambda *_: None)
    monkeypatch.setattr(card_self_test, "run_self_test", run)
    return found


@pytest.mark.parametrize("kernel", ["full", "media"])
def test_failure_that_may_have_passed_is_tested_again(kernel: str, tested: list[str]) -> None:
    """Also that of a kernel which is tested before its first use only."""
    for each in ("plain", "full"):
        keep_verdict(CARD, each, each, Verdict("", True))
    keep_verdict(CARD, kernel, kernel, Verdict("another program took its memory", False))
    assert check_kernel(LINK, CARD, kernel).endswith("another program took its memory."), "this worker does not test again"
    assert check_cards(LINK, [CARD]) == ([CARD], [])
    assert verdicts.failure_of(CARD) == ""
    assert check_kernel(LINK, CARD, kernel) == ""
    assert tested == [kernel]


def test_card_with_a_lasting_failure_is_not_used(tested: list[str]) -> None:
    keep_verdict(CARD, "media", "media", Verdict("it computed other bits", True))
    passed, (reason,) = check_cards(LINK, [CARD])
    assert passed == [] and reason.endswith("it computed other bits.")
    assert tested == []
