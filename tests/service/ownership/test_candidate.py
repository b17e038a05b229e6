"""Tests of two services on one database, with a simulated clock: one owns the farm, and writes of the other are refused."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text

from service.errors import NotOwner, StartupError, Unavailable
from service.ownership import rows
from service.ownership.candidate import Candidate, take_farm
from service.ownership.owner_timeout import MIN_CHECKS
from service.ownership.ownership import Ownership
from service.settings import Settings
from service.store.models import Scene
from tests.service.conftest import new_sqlite

LEASE_S = 6.0


class Time:
    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock() -> Time:
    return Time()


@pytest.fixture
def candidates(tmp_path: Path, database: str, clock: Time) -> Iterator[Callable[..., Candidate]]:
    """Returns a factory of candidates for ownership, by default in the folder `data`."""
    made: list[Candidate] = []
    url = database or new_sqlite(tmp_path)

    def make(folder: str = "data", **settings: Any) -> Candidate:
        made.append(Candidate(Settings(data=tmp_path / folder, database_url=url, lease_s=LEASE_S, **settings), clock))
        return made[-1]

    yield make
    for candidate in made:
        candidate.close()


def assert_owner(candidate: Candidate) -> Ownership:
    found = candidate.attempt()
    assert found is not None
    return found


def move_owner_to_another_machine(owning: Ownership) -> None:
    """Makes the owner's database row look like that of another machine, whose process cannot be checked."""
    with owning._bare.begin() as session:
        session.execute(text("UPDATE owners SET process = NULL, locked = :no"), {"no": False})


def wait(candidate: Candidate, clock: Time, seconds: float) -> Ownership | None:
    """Stands by for `seconds`; returns the ownership if it was obtained, else None."""
    until = clock.now + seconds
    while clock.now < until:
        if (found := candidate.attempt()) is not None:
            return found
        clock.now += 0.5
    return None


def test_first_service_owns_farm_until_release(candidates: Callable[..., Candidate], clock: Time) -> None:
    first = assert_owner(candidates())
    second = candidates()
    assert second.attempt() is None
    first.stop()
    clock.now += 0.5
    follower = assert_owner(second)
    assert follower.epoch > first.epoch
    row = rows.current_owner(follower.sessions)
    assert row is not None
    assert row.takeovers == 0, "it was given up"


@pytest.mark.long
def test_answering_owner_keeps_farm(candidates: Callable[..., Candidate], clock: Time) -> None:
    first = assert_owner(candidates())
    second = candidates()
    for _ in range(100):
        assert second.attempt() is None
        first.confirm()
        clock.now += 0.5
    assert not first.is_lost


def test_owner_with_free_folder_lock_is_dead(candidates: Callable[..., Candidate]) -> None:
    first = assert_owner(candidates())
    second = candidates()
    first._folder.release()  # as the system does when a process ends
    follower = assert_owner(second)
    row = rows.current_owner(follower.sessions)
    assert row is not None
    assert row.takeovers == 1


def test_free_lock_proves_nothing_if_owner_never_held_it(candidates: Callable[..., Candidate], clock: Time) -> None:
    first = assert_owner(candidates())
    move_owner_to_another_machine(first)
    first._folder.release()
    second = candidates()
    assert wait(second, clock, LEASE_S - 1.0) is None
    assert not second._lock.is_held, "who stands by leaves it to the owner"
    first.confirm()
    assert first._folder.is_held
    row = rows.current_owner(first.sessions)
    assert row is not None
    assert row.locked


def test_hanging_owner_is_replaced_and_fenced(candidates: Callable[..., Candidate], clock: Time) -> None:
    first = assert_owner(candidates())
    move_owner_to_another_machine(first)
    second = candidates()
    begun = clock.now
    follower = wait(second, clock, 3 * LEASE_S)
    assert follower is not None
    assert LEASE_S < clock.now - begun <= LEASE_S + 1.5
    with follower.sessions.begin() as session:
        session.add(scene("of the new owner"))
    with pytest.raises(NotOwner), first.sessions.begin() as session:
        session.add(scene("of the old one"))
    with first.sessions() as session:
        assert session.get(Scene, "of the old one") is None
    assert first.is_lost
    with pytest.raises(NotOwner):
        first.guard()
    follower.guard()


def test_resumed_owner_checks_ownership_before_acting(candidates: Callable[..., Candidate], clock: Time) -> None:
    first = assert_owner(candidates())
    move_owner_to_another_machine(first)
    first.guard()
    assert wait(candidates(), clock, 3 * LEASE_S) is not None
    assert not first.is_lost, "nobody has told it"
    assert first.is_doubtful
    with pytest.raises(NotOwner):
        first.guard()
    assert first.is_lost


def test_owner_continues_while_database_is_unreachable(
    candidates: Callable[..., Candidate], clock: Time, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = assert_owner(candidates())
    looked = []

    def away(_: object) -> None:
        looked.append(clock.now)
        raise Unavailable("away")

    monkeypatch.setattr(rows, "current_owner", away)
    clock.now += 2 * LEASE_S
    for _ in range(5):
        first.guard()
    assert len(looked) == 1, "it is not waited for each time"
    first._heard = True
    with pytest.raises(Unavailable, match="still owns the farm"):
        first.guard()


def test_loss_of_ownership_is_reported_once(candidates: Callable[..., Candidate], clock: Time) -> None:
    first = assert_owner(candidates())
    told: list[None] = []
    first._on_lost = lambda: told.append(None)
    first._folder.release()
    second = assert_owner(candidates())
    for _ in range(3):
        first.confirm()
        with pytest.raises(NotOwner):
            first.guard()
    assert len(told) == 1
    first.stop()
    row = rows.current_owner(second._bare)
    assert row is not None
    assert row.owner is not None, "what is another's is not given up"


def test_owner_without_progress_does_not_answer(candidates: Callable[..., Candidate], clock: Time) -> None:
    first = assert_owner(candidates())
    first._moves = lambda: False
    second = candidates()
    for _ in range(MIN_CHECKS + int(2 * LEASE_S) + 2):
        if second.attempt() is not None:
            return
        first.confirm()
        clock.now += 0.5
    pytest.fail("the second never takes over")


def test_other_folder_with_same_database_is_rejected(candidates: Callable[..., Candidate], clock: Time) -> None:
    first = assert_owner(candidates())
    second = candidates("another")
    assert second.attempt() is None
    first.confirm()
    clock.now += 0.5
    with pytest.raises(StartupError, match="with films in another folder"):
        second.attempt()


def test_only_one_of_two_candidates_gets_farm(candidates: Callable[..., Candidate]) -> None:
    first = assert_owner(candidates())
    seen = rows.current_owner(first._bare)
    me = candidates()._me
    assert rows.take_ownership(first._bare, seen, me, has_lock=False) is not None
    assert rows.take_ownership(first._bare, seen, me, has_lock=False) is None


def test_second_service_without_standby_is_rejected(tmp_path: Path) -> None:
    first = take_farm(Settings(data=tmp_path), 0.0)
    with pytest.raises(StartupError, match="Another service uses"):
        take_farm(Settings(data=tmp_path), 0.0)
    first.stop()
    take_farm(Settings(data=tmp_path), 0.0).stop()


def test_damaged_database_gives_error(tmp_path: Path) -> None:
    (tmp_path / "rayfarm.sqlite").write_bytes(b"no database" * 1000)
    with pytest.raises(StartupError, match=r"The database is damaged \(file is not a database\). `rayfarm doctor"):
        take_farm(Settings(data=tmp_path), 0.0)


def scene(id: str) -> Scene:
    return Scene(id=id, name=id, status="ready", created=0.0, main="a.obj", files=[], bytes=0)
