"""What slots share of a joint batch, with processes that end at the worst moment."""

from __future__ import annotations

import multiprocessing
import os
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from worker import shares as module
from worker.contract import Result
from worker.shares import Share, Shares


@pytest.fixture
def shares(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Shares]:
    monkeypatch.setattr(module.tempfile, "tempdir", str(tmp_path))
    made = Shares()
    yield made
    made.close()


def result(number: int) -> Result:
    return Result({"type": "batch", "first": number}, bytes([number]) * 9)


def taken(shares: Shares) -> Share:
    share = shares.take()
    assert share is not None
    return share


def in_a_process_that_is_killed(shares: Shares, action: str) -> None:
    def act() -> None:
        share = shares.take()
        if action == "put" and share is not None:
            shares.put(share, result(share.number))
        if action == "send":
            next(iter(shares.ripe()))
        os._exit(9)

    process = multiprocessing.get_context("fork").Process(target=act)
    process.start()
    process.join()


def sent(shares: Shares, at_once: bool = False) -> list[list[int]]:
    return [[each.event["first"] for each in results] for results in shares.ripe(at_once)]


def test_each_piece_is_taken_once_and_sums_go_together_when_the_last_is_there(shares: Shares) -> None:
    shares.begin("m", b"words", range(3), 60.0)
    mine = [taken(shares) for _ in range(3)]
    assert shares.take() is None
    assert [share.about for share in mine] == [b"words"] * 3
    for share in (mine[2], mine[0]):
        shares.put(share, result(share.number))
        assert sent(shares) == []
        assert shares.messages() == ["m"]
    shares.put(mine[1], result(1))
    (results,) = shares.ripe()
    assert [(each.event["first"], each.sums) for each in results] == [(n, bytes([n]) * 9) for n in range(3)]
    assert shares.messages() == []
    assert sent(shares) == []


def test_the_oldest_message_comes_first(shares: Shares) -> None:
    for name in ("b", "a"):
        shares.begin(name, name.encode(), range(1), 60.0)
    assert [taken(shares).about, taken(shares).about] == [b"b", b"a"]


def test_sums_wait_no_longer_than_they_may(shares: Shares) -> None:
    shares.begin("m", b"", range(2), 0.5)
    share = taken(shares)
    shares.put(share, result(share.number))
    assert sent(shares) == []
    old = time.time() - 1
    os.utime(next(share.folder.glob("done-*")), (old, old))
    assert sent(shares) == [[0]]
    assert taken(shares).number == 1, "the other piece goes on"


def test_a_killed_slots_piece_is_let_go_of_and_the_others_are_sent(shares: Shares) -> None:
    shares.begin("m", b"", range(2), 60.0)
    in_a_process_that_is_killed(shares, "take")
    share = taken(shares)
    shares.put(share, result(share.number))
    assert sent(shares) == [[1]]
    assert shares.messages() == []


def test_what_a_killed_slot_was_about_to_send_is_sent_by_another(shares: Shares) -> None:
    shares.begin("m", b"", range(1), 60.0)
    in_a_process_that_is_killed(shares, "put")
    in_a_process_that_is_killed(shares, "send")
    assert shares.messages() == ["m"], "it is not lost"
    assert sent(shares) == [[0]]
    assert shares.messages() == []


def test_a_message_that_comes_again_is_taken_over_but_for_what_others_have(shares: Shares) -> None:
    shares.begin("m", b"", range(4), 60.0)
    in_a_process_that_is_killed(shares, "take")
    in_a_process_that_is_killed(shares, "put")
    mine = taken(shares)
    assert shares.take_over("m") == [0, 3]
    assert shares.take_over("another") is None
    shares.put(mine, result(mine.number))
    assert sent(shares) == [[1, 2]]


def test_at_the_end_what_nobody_has_begun_is_taken_back_and_all_sums_are_sent(shares: Shares) -> None:
    shares.begin("m", b"words", range(3), 60.0)
    share = taken(shares)
    shares.put(share, result(0))
    assert shares.withdraw() == [(b"words", [1, 2])]
    assert sent(shares, at_once=True) == [[0]]
    assert shares.take() is None


def test_a_piece_that_comes_to_nothing_holds_nobody_up(shares: Shares) -> None:
    shares.begin("m", b"", range(2), 60.0)
    first, second = taken(shares), taken(shares)
    shares.put(first, result(0))
    shares.let_go(second)
    assert sent(shares) == [[0]]


def test_damaged_sums_are_left_out(shares: Shares) -> None:
    shares.begin("m", b"", range(2), 60.0)
    for _ in range(2):
        share = taken(shares)
        shares.put(share, result(share.number))
    (share.folder / "done-0000").write_bytes(b"\xff")
    assert sent(shares) == [[1]]


def test_an_id_that_is_a_path_is_refused(shares: Shares) -> None:
    with pytest.raises(ValueError, match="no id"):
        shares.begin("../m", b"", range(1), 1.0)


def test_what_a_killed_worker_left_is_removed_and_a_living_ones_stays(shares: Shares, tmp_path: Path) -> None:
    left = tmp_path / f"{module.PREFIX}left"
    left.mkdir()
    (left / "lock").touch()
    other = Shares()
    assert not left.exists()
    assert shares.root.exists()
    other.close()
    assert not other.root.exists()
