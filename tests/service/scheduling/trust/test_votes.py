"""Tests of determining the correct result of a batch: the result that two different workers returned."""

from __future__ import annotations

import lz4.block
import pytest

from protocol.sums import pack_sums
from renderer.settings import Tile
from service.scheduling.trust.votes import Votes
from tests.service.peer_worker import expected_sums

TILE = Tile(0, 0, 8, 4)
X, Y, Z = (pack_sums(expected_sums(TILE, 0, 2, seed)) for seed in range(3))


def votes(*cast: tuple[str, bytes]) -> Votes:
    made = Votes(TILE)
    for worker, sums in cast:
        made.add(worker, sums)
    return made


@pytest.mark.parametrize(
    ("cast", "wrong", "is_known"),
    [
        ([("a", X)], set(), False),
        ([("a", X), ("b", X)], set(), True),
        ([("a", X), ("a", X)], set(), False),
        ([("a", X), ("b", Y)], set(), False),
        ([("a", X), ("b", Y), ("c", X)], {"b"}, True),
        ([("a", X), ("b", Y), ("c", Y)], {"a"}, True),
        ([("a", X), ("b", Y), ("c", Z)], set(), False),
        ([("a", X), ("b", Y), ("c", Z), ("d", Z)], {"a", "b"}, True),
        ([("a", X), ("b", Y), ("b", X)], {"b"}, True),
        ([("a", X), ("b", Y), ("b", Y), ("a", X)], set(), False),
    ],
)
def test_two_equal_results_are_correct(cast: list[tuple[str, bytes]], wrong: set[str], is_known: bool) -> None:
    found = votes(*cast)
    assert (found.outvoted_workers, found.agreed_index is not None) == (wrong, is_known)


def test_workers_of_one_token_count_as_one() -> None:
    one, two, other = "a.0123456789ab", "b.0123456789ab", "a.ba9876543210"
    assert votes((one, X), (two, X)).agreed_index is None
    assert votes((one, X), (two, X), (other, Y), ("near", Y)).outvoted_workers == {one, two}
    assert not votes((one, X)).could_decide({one, two})
    assert votes((one, X)).could_decide({one, two, other})


def test_equal_sums_with_other_packing_are_equal() -> None:
    plain = pack_sums(expected_sums(TILE, 0, 2, 0), packing=1)
    assert plain != X
    assert votes(("a", X), ("b", plain)).agreed_index == 0
    with pytest.raises(ValueError, match="sums"):
        votes(("a", lz4.block.compress(b"no sums", store_size=False)))


def test_further_workers_are_asked_while_undecided() -> None:
    two = votes(("a", X), ("b", Y))
    assert two.could_decide({"a", "b"})
    two.add("a", X)
    two.add("b", Y)
    assert not two.could_decide({"a", "b"})
    assert two.could_decide({"a", "b", "c"})
    assert not votes(("a", X)).could_decide({"a"})
    two.remove_worker("b")
    assert (two.workers, two.has_differences) == ({"a"}, False)
