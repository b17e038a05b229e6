"""Tests of the second worker that renders with cards: its search, its start, its restarts, and what is reported of cards."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from renderer.cuda import verdicts
from renderer.cuda.driver import Card
from renderer.cuda.verdicts import Verdict, keep_verdict
from tests.helpers import wait_until
from worker.machine import cards_worker
from worker.machine.cards_worker import EXIT_NO_CARDS, EXIT_REFUSED, CardsWorker
from worker.machine.status import SlotBoard
from worker.process.context import WorkerContext

FOUND = (
    '[[[0, "RTX Test", [8, 6], 8589934592, 1, "01", "570"], [1, "RTX Two", [9, 0], 8589934592, 1, "02", "570"]], ["Too weak."]]'
)
CARD = Card(0, "RTX Test", (8, 6), 8 << 30, 1, "01", "570")
LABEL = "Card 0: RTX Test, 8 GiB, compute capability 8.6"


@pytest.fixture
def second(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Callable[..., CardsWorker]]:
    """Returns a function that makes a CardsWorker whose search prints `found` and whose second worker runs `program`."""
    made: list[CardsWorker] = []

    def make(program: str, choice: str = "auto", found: str = FOUND, code: int = 0) -> CardsWorker:
        search = f"import sys; print({found!r}); sys.exit({code})"
        monkeypatch.setattr(cards_worker, "search_command", lambda: [sys.executable, "-c", search])
        worker = CardsWorker(choice, ["--slots=2", "--name=attic"], "attic-gpu", "t", lambda: failed.append(1))
        assert worker._command[1:3] == ["-m", "worker"]
        worker._command[1:3] = ["-c", f"import os, sys, time\n{program}"]
        made.append(worker)
        return worker

    failed: list[int] = []
    monkeypatch.setattr(make, "failed", failed, raising=False)
    monkeypatch.setattr(cards_worker, "PAUSES_S", (0.0,))
    monkeypatch.setattr(verdicts, "private_folder", lambda name: tmp_path / name)
    yield make
    for each in made:
        each.stop()
        each.wait()


def checked_until(worker: CardsWorker, condition: Callable[[], Any]) -> None:
    wait_until(lambda: (worker.check(), condition())[1], 30, "the second worker is checked")


def test_second_worker_gets_the_options_of_the_first(second: Any, tmp_path: Path) -> None:
    said = tmp_path / "said"
    line = f"open({str(said)!r} + '.part', 'w').write(' '.join([*sys.argv[1:], os.environ['RAYFARM_TOKEN']])); "
    worker = second(f"{line} os.rename({str(said)!r} + '.part', {str(said)!r}); time.sleep(60)")
    assert worker.unused() == []
    checked_until(worker, said.exists)
    assert said.read_text() == "--slots=2 --name=attic --gpu=auto --paired --name=attic-gpu t"


def test_unused_cards_have_reasons_until_they_pass(second: Any) -> None:
    worker = second("time.sleep(60)", choice="0")
    checked_until(worker, lambda: worker._process is not None)
    not_chosen = "Card 1: RTX Two, 8 GiB, compute capability 9.0 is not used. To use it, start the worker with 1 in --gpu."
    assert worker.unused() == [not_chosen, "Too weak.", f"{LABEL} is not used: its self-test has not ended."]
    keep_verdict(CARD, "plain", "ptx", Verdict("", True))
    assert len(worker.unused()) == 3
    keep_verdict(CARD, "full", "ptx", Verdict("", True))
    assert worker.unused() == [not_chosen, "Too weak."]
    keep_verdict(CARD, "media", "ptx", Verdict("it computed other bits", True))
    assert worker.unused() == [not_chosen, "Too weak.", f"{LABEL} is not used: it computed other bits."]


@pytest.mark.parametrize(
    ("choice", "code", "fails"), (("auto", EXIT_NO_CARDS, 0), ("auto", EXIT_REFUSED, 0), ("all", EXIT_REFUSED, 1))
)
def test_failed_self_test_is_an_error_only_on_request(second: Any, choice: str, code: int, fails: int, tmp_path: Path) -> None:
    starts = tmp_path / "starts"
    worker = second(f"open({str(starts)!r}, 'a').write('x'); sys.exit({code})", choice)
    checked_until(worker, lambda: worker._is_over)
    worker.check()
    assert starts.read_text() == "x"
    assert len(second.failed) == fails


def test_ended_worker_is_started_again(second: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    starts = tmp_path / "starts"
    with caplog.at_level(logging.WARNING, "worker"):
        worker = second(f"open({str(starts)!r}, 'a').write('x'); sys.exit(1)")
        checked_until(worker, lambda: starts.exists() and len(starts.read_text()) >= 3)
    assert "the worker with the cards ended (exit code 1); it starts again in 0 s" in caplog.messages


def test_start_is_tried_again(second: Any, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    worker, start, failures = second("time.sleep(60)"), cards_worker._started, [OSError(11, "no process is left")] * 2

    def started(*given: Any) -> Any:
        if failures:
            raise failures.pop()
        return start(*given)

    monkeypatch.setattr(cards_worker, "_started", started)
    with caplog.at_level(logging.WARNING, "worker"):
        checked_until(worker, lambda: worker._process is not None)
    assert len(caplog.messages) == 2
    assert "no process is left); the next try is in 0 s" in caplog.messages[0]


@pytest.mark.parametrize(
    ("choice", "found", "code", "said", "fails"),
    (
        ("auto", '[[], ["No graphics card is used: it is too old."]]', 0, "it is too old", 0),
        ("auto", "", 1, "the search failed: exit code 1", 0),
        ("7", FOUND, 0, "is not used. To use it", 1),
        ("first", FOUND, 0, "is not used. To use it", 1),
    ),
)
def test_without_a_usable_card_no_process_is_started(
    second: Any, choice: str, found: str, code: int, said: str, fails: int
) -> None:
    worker = second("", choice, found, code)
    checked_until(worker, lambda: worker._is_over)
    assert worker._process is None
    assert said in worker.unused()[0]
    assert len(second.failed) == fails


def test_report_leaves_out_a_card_that_failed_a_later_test(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(verdicts, "private_folder", lambda name: tmp_path / name)
    nothing: Any = None
    other = Card(1, "RTX Two", (9, 0), 8 << 30, 1, "02", "570")
    context = WorkerContext("w", 2, "kind", "redis://", nothing, nothing, SlotBoard(2), cards=(CARD, other))
    assert [card["slot"] for card in context.report().cards] == [0, 1]
    keep_verdict(CARD, "media", "ptx", Verdict("it computed other bits", True))
    report = context.report()
    assert [(card["number"], card["slot"]) for card in report.cards] == [(1, 1)]
    assert "it computed other bits" in report.cards_unused[0]
    assert report.has_card_queue
