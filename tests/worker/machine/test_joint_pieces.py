"""Tests of sharing the pieces of joint batches among slots, including slots that end while they render or send a piece."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from protocol.contract import Result
from worker.machine import joint_pieces as module
from worker.machine.joint_pieces import ClaimedPiece, Pieces


@pytest.fixture
def pieces(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Pieces]:
    monkeypatch.setattr(module.tempfile, "tempdir", str(tmp_path))
    made = Pieces()
    yield made
    made.close()


def result(number: int) -> Result:
    return Result({"type": "batch", "first": number}, bytes([number]) * 9)


def claim_piece(pieces: Pieces) -> ClaimedPiece:
    taken = pieces.claim()
    assert taken is not None
    return taken


def in_a_process_that_is_killed(pieces: Pieces, action: str) -> None:
    def act() -> None:
        taken = pieces.claim()
        if action == "put" and taken is not None:
            pieces.store_result(taken, result(taken.number))
        if action == "send":
            next(iter(pieces.due_results()))
        os._exit(9)

    process = multiprocessing.get_context("fork").Process(target=act)
    process.start()
    process.join()


def due_numbers(pieces: Pieces, at_once: bool = False) -> list[list[int]]:
    return [[each.event["first"] for each in results] for results in pieces.due_results(at_once)]


def test_each_piece_is_claimed_once_and_sums_are_due_when_all_are_done(pieces: Pieces) -> None:
    pieces.add_message("m", b"words", range(3), 60.0)
    mine = [claim_piece(pieces) for _ in range(3)]
    assert pieces.claim() is None
    assert [taken.about for taken in mine] == [b"words"] * 3
    for taken in (mine[2], mine[0]):
        pieces.store_result(taken, result(taken.number))
        assert due_numbers(pieces) == []
        assert pieces.messages() == ["m"]
    pieces.store_result(mine[1], result(1))
    (results,) = pieces.due_results()
    assert [(each.event["first"], each.sums) for each in results] == [(n, bytes([n]) * 9) for n in range(3)]
    assert pieces.messages() == []
    assert due_numbers(pieces) == []


def test_oldest_message_is_claimed_first(pieces: Pieces) -> None:
    for name in ("b", "a"):
        pieces.add_message(name, name.encode(), range(1), 60.0)
    assert [claim_piece(pieces).about, claim_piece(pieces).about] == [b"b", b"a"]


def test_sums_are_due_after_hold_time(pieces: Pieces) -> None:
    pieces.add_message("m", b"", range(2), 0.5)
    taken = claim_piece(pieces)
    pieces.store_result(taken, result(taken.number))
    assert due_numbers(pieces) == []
    old = time.time() - 1
    os.utime(next(taken.folder.glob("done-*")), (old, old))
    assert due_numbers(pieces) == [[0]]
    assert claim_piece(pieces).number == 1, "the other piece goes on"


def test_piece_of_killed_slot_is_released(pieces: Pieces) -> None:
    pieces.add_message("m", b"", range(2), 60.0)
    in_a_process_that_is_killed(pieces, "take")
    taken = claim_piece(pieces)
    pieces.store_result(taken, result(taken.number))
    assert due_numbers(pieces) == [[1]]
    assert pieces.messages() == []


def test_unsent_sums_of_killed_slot_are_sent(pieces: Pieces) -> None:
    pieces.add_message("m", b"", range(1), 60.0)
    in_a_process_that_is_killed(pieces, "put")
    in_a_process_that_is_killed(pieces, "send")
    assert pieces.messages() == ["m"], "it is not lost"
    assert due_numbers(pieces) == [[0]]
    assert pieces.messages() == []


def test_redelivered_message_keeps_pieces_of_live_slots(pieces: Pieces) -> None:
    pieces.add_message("m", b"", range(4), 60.0)
    in_a_process_that_is_killed(pieces, "take")
    in_a_process_that_is_killed(pieces, "put")
    mine = claim_piece(pieces)
    assert pieces.withdraw_unfinished("m") == [0, 3]
    assert pieces.withdraw_unfinished("another") is None
    pieces.store_result(mine, result(mine.number))
    assert due_numbers(pieces) == [[1, 2]]


def test_shutdown_withdraws_free_pieces_and_sends_sums(pieces: Pieces) -> None:
    pieces.add_message("m", b"words", range(3), 60.0)
    taken = claim_piece(pieces)
    pieces.store_result(taken, result(0))
    assert pieces.withdraw() == [(b"words", [1, 2])]
    assert due_numbers(pieces, at_once=True) == [[0]]
    assert pieces.claim() is None


def test_abandoned_piece_does_not_delay_sums(pieces: Pieces) -> None:
    pieces.add_message("m", b"", range(2), 60.0)
    first, second = claim_piece(pieces), claim_piece(pieces)
    pieces.store_result(first, result(0))
    pieces.release(second)
    assert due_numbers(pieces) == [[0]]


def test_damaged_sums_are_skipped(pieces: Pieces) -> None:
    pieces.add_message("m", b"", range(2), 60.0)
    for _ in range(2):
        taken = claim_piece(pieces)
        pieces.store_result(taken, result(taken.number))
    (taken.folder / "done-0000").write_bytes(b"\xff")
    assert due_numbers(pieces) == [[1]]


def test_message_id_with_path_is_rejected(pieces: Pieces) -> None:
    with pytest.raises(ValueError, match="not a message id"):
        pieces.add_message("../m", b"", range(1), 1.0)


def test_folders_of_killed_workers_are_removed(pieces: Pieces, tmp_path: Path) -> None:
    left = tmp_path / f"{module.PREFIX}left"
    left.mkdir()
    (left / "lock").touch()
    other = Pieces()
    assert not left.exists()
    assert pieces.root.exists()
    other.close()
    assert not other.root.exists()
