"""The database row that records the farm's owner.

Each function runs one transaction, and raises Unavailable if the database does not respond.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

from sqlalchemy import select, update
from sqlalchemy.exc import IntegrityError

from service.store.database import Sessions
from service.store.models import FarmOwner

__all__ = ["FARM", "Claimant", "current_owner", "give_up", "record_answer", "request_answer", "take_ownership"]

FARM = "farm"


@dataclass(frozen=True)
class Claimant:
    """A run of a service process that can become the owner of the farm.

    place: machine and port, for display. url: its URL for other services. folder: id of its data folder. process: identification
    of the process (service/ownership/process.py).
    """

    id: str
    place: str
    url: str
    folder: str
    process: dict[str, Any] | None


def current_owner(sessions: Sessions) -> FarmOwner | None:
    """Returns the owner's row; None if the farm never had an owner."""
    with sessions() as session:
        return session.get(FarmOwner, FARM)


def take_ownership(sessions: Sessions, last_row: FarmOwner | None, claimant: Claimant, has_lock: bool) -> int | None:
    """Takes ownership. Returns the new epoch, or None if another service was faster.

    last_row: the owner's row that was found to be free; None if there was no row. has_lock: whether this service holds the
    folder's lock.
    """
    try:
        with sessions.begin() as session:
            # FOR UPDATE: waits for all transactions of the owner in progress; later ones see the new epoch.
            row = session.get(FarmOwner, FARM, with_for_update=True)
            if (row and row.epoch) != (last_row and last_row.epoch):
                return None
            if row is None:
                row = FarmOwner(what=FARM, epoch=0, takeovers=0, asked=0, answered=0)
                session.add(row)
            row.takeovers += row.owner is not None
            # At least the clock's value: after restoring an older database, films with a later epoch must not stay foreign
            # forever.
            row.epoch = max(row.epoch + 1, int(time.time()))
            row.owner, row.place, row.url, row.folder = claimant.id, claimant.place, claimant.url, claimant.folder
            row.process, row.locked, row.since = claimant.process, has_lock, time.time()
            row.answered = row.asked
            return row.epoch
    except IntegrityError:  # there was no row, and another service inserted it at the same time
        return None


def request_answer(sessions: Sessions, place: str) -> int:
    """Requests a sign of life from the owner: increases the request number in the row, and returns it.

    The owner must write this number back. place: machine and port of the requesting service.
    """
    with sessions.begin() as session:
        session.execute(
            update(FarmOwner)
            .where(FarmOwner.what == FARM)
            .values(asked=FarmOwner.asked + 1, asked_by=place, asked_at=time.time())
        )
        return session.scalar(select(FarmOwner.asked).where(FarmOwner.what == FARM)) or 0


def record_answer(sessions: Sessions, epoch: int, number: int, has_lock: bool) -> bool:
    """Records the owner's answer to request number `number`. Returns False if this service is no longer the owner."""
    with sessions.begin() as session:
        changed = session.execute(
            update(FarmOwner).where(FarmOwner.what == FARM, FarmOwner.epoch == epoch).values(answered=number, locked=has_lock)
        )
        return bool(changed.rowcount)  # type: ignore[attr-defined]


def give_up(sessions: Sessions, epoch: int) -> None:
    """Records that this service has released the farm."""
    with sessions.begin() as session:
        session.execute(
            update(FarmOwner).where(FarmOwner.what == FARM, FarmOwner.epoch == epoch).values(owner=None, process=None)
        )
