"""Keys: the secrets of sessions, tokens, links and workers. Created once, stored as a hash, revocable at any time."""

from __future__ import annotations

import contextlib
import secrets
import threading
import time
from collections import Counter
from dataclasses import dataclass
from typing import Any, Literal, cast

from sqlalchemy import ColumnElement, CursorResult, Select, delete, func, or_, select, update
from sqlalchemy.orm import Session

from renderer.sentences import Sentence
from service.access.roles import OWNER, Caller, Role
from service.access.secrets import fingerprint, new_secret
from service.errors import FarmError, NotFound
from service.store.database import Sessions
from service.store.models import Key, User

__all__ = ["CACHE_TTL_S", "KeyKind", "Keys", "Share"]

KeyKind = Literal["session", "token", "link", "worker", "share"]
_LABELS: dict[KeyKind, str] = {
    "session": Sentence("key-session", "session"),
    "token": Sentence("key-token", "token"),
    "link": Sentence("key-login-link", "login link"),
    "worker": Sentence("key-worker-token", "worker token"),
    "share": Sentence("key-share-link", "share link"),
}
CACHE_TTL_S = 3.0  # seconds for which a key is cached: another process may revoke it
LAST_USE_INTERVAL_S = 300.0
MAX_CACHED = 4096
KEEP_EXPIRED_S = 30 * 86400.0  # seconds that an expired key is kept, in case the clock was temporarily ahead


@dataclass(frozen=True)
class Share:
    """The rights that a share link gives. job: the only job that it shows.

    creator: the user who created the link; it shows no more than this user may see at present. comments: whether it also allows
    notes on the picture.
    """

    id: str
    job: str
    expires: float | None
    creator: Caller
    comments: bool


@dataclass(frozen=True)
class _CachedKey:
    caller: Caller
    expires: float | None
    read: float  # time.monotonic()


class Keys:
    """The keys in the database, with a short-lived cache of recently used keys."""

    def __init__(self, sessions: Sessions) -> None:
        self._sessions = sessions
        self._lock = threading.Lock()
        self._known: dict[str, _CachedKey] = {}
        self._version = 0

    def create(
        self, kind: KeyKind, user: str, role: Role, name: str = "", lasts_s: float | None = None, *, comments: bool = False
    ) -> tuple[str, Key]:
        """Creates a key; returns its secret, which is not stored, and its row.

        lasts_s: lifetime in seconds; None: unlimited. comments: whether a share link allows notes. Raises NotFound if the user
        does not exist.
        """
        secret, now = new_secret(kind), time.time()
        row = Key(
            id=secrets.token_hex(6), hash=fingerprint(secret), kind=kind, user=user, name=name, role=role.api_name, created=now
        )
        row.expires, row.comments = None if lasts_s is None else now + lasts_s, comments
        with self._sessions.begin() as session:
            if user != OWNER and session.get(User, user, with_for_update={"read": True, "key_share": True}) is None:
                raise NotFound(
                    Sentence(
                        "key-user-gone",
                        "The user {user} does not exist any more. Choose another, or add it again.",
                        user=repr(user[:64]),
                    )
                )  # else the key would admit a later user of this name
            session.execute(delete(Key).where(Key.expires < now - KEEP_EXPIRED_S))
            session.add(row)
        return secret, row

    def cached_caller(self, secret: str) -> Caller | None:
        """Returns the caller who owns this key, or None if it is not in the cache. Does not query the database."""
        known = self._known.get(fingerprint(secret))
        if known is None or time.monotonic() - known.read > CACHE_TTL_S or _has_expired(known.expires):
            return None
        return known.caller

    def find(self, secret: str) -> Caller | None:
        """Returns the caller who owns this key.

        None if the key is unknown, expired or revoked, or is a link (see `use_link`, `find_share`).
        """
        hash, version = fingerprint(secret), self._version
        with self._sessions() as session:
            row = session.scalar(select(Key).where(Key.hash == hash, Key.kind.not_in(("link", "share"))))
            caller = None if row is None or _has_expired(row.expires) else _caller_of(row, session)
        if row is None or caller is None:
            return None
        if row.seen is None or time.time() - row.seen > LAST_USE_INTERVAL_S:
            with contextlib.suppress(FarmError), self._sessions.begin() as session:
                session.execute(update(Key).where(Key.id == row.id).values(seen=time.time()))
        with self._lock:
            if version == self._version:
                if len(self._known) >= MAX_CACHED:
                    self._known.clear()
                self._known[hash] = _CachedKey(caller, row.expires, time.monotonic())
        return caller

    def find_share(self, secret: str) -> Share | None:
        """Returns the rights that the share link with this secret gives.

        None if the link is unknown, expired or revoked, or if its creator may not view anything.
        """
        with self._sessions() as session:
            row = session.scalar(select(Key).where(Key.hash == fingerprint(secret), *_is_valid_clauses("share")))
            role = Role.NOBODY if row is None else _role_of(row.user, session)
        if row is None or role < Role.VIEW:
            return None
        return Share(row.id, row.name, row.expires, Caller(row.user, role, "token", row.id), bool(row.comments))

    def shares_of(self, job: str) -> list[Key]:
        """Returns the valid share links of a job, newest first."""
        with self._sessions() as session:
            return list(session.scalars(self.select_valid(("share",)).where(Key.name == job)))

    def withdraw_share(self, job: str, id: str) -> None:
        """Revokes a share link of a job. Raises NotFound."""
        if id not in {row.id for row in self.shares_of(job)}:
            id = ""
        self.withdraw("share", id)

    def use_link(self, secret: str) -> str | None:
        """Consumes a login link: deletes it and returns its user's name.

        None if the link is invalid or expired, or the user is deleted.
        """
        found = Key.hash == fingerprint(secret), Key.kind == "link"
        with self._sessions.begin() as session:
            row = session.scalar(select(Key).where(*found))
            # Of two simultaneous uses, one deletes the row.
            deleted = cast("CursorResult[Any]", session.execute(delete(Key).where(*found))).rowcount
            if row is None or deleted != 1 or _has_expired(row.expires):
                return None
            return row.user if _role_of(row.user, session) is not Role.NOBODY else None

    def listed(self, kind: KeyKind, user: str | None = None) -> list[Key]:
        """Returns the valid keys of one kind, newest first. user: returns only this user's keys; None: those of all users."""
        with self._sessions() as session:
            return list(session.scalars(self.select_valid((kind,), user)))

    @staticmethod
    def select_valid(kinds: tuple[KeyKind, ...], user: str | None = None) -> Select[Any]:
        """Returns the query for the valid keys of the given kinds, newest first.

        user: only this user's keys and all worker keys; None: the keys of all users.
        """
        wanted = select(Key).where(*_is_valid_clauses(*kinds)).order_by(Key.created.desc(), Key.id)
        return wanted if user is None else wanted.where((Key.user == user) | (Key.kind == "worker"))

    def exists(self, kind: KeyKind, id: str) -> bool:
        """Returns True if a key with this kind and id exists."""
        with self._sessions() as session:
            return session.scalar(select(Key.id).where(Key.id == id, Key.kind == kind)) is not None

    def count(self, kind: KeyKind, users: list[str]) -> Counter[str]:
        """Returns the number of valid keys of a kind for each of the given users."""
        with self._sessions() as session:
            query = select(Key.user, func.count()).where(*_is_valid_clauses(kind), Key.user.in_(users)).group_by(Key.user)
            return Counter({user: count for user, count in session.execute(query)})  # noqa: C416 - typed

    def withdraw(self, kind: KeyKind, id: str, user: str | None = None) -> Key:
        """Revokes a key and returns the database row that it had. Raises NotFound.

        user: revokes the key only if it belongs to this user; None: any user's key.
        """
        with self._sessions.begin() as session:
            row = session.get(Key, id)
            if row is None or row.kind != kind or (user is not None and row.user != user):
                raise NotFound(
                    Sentence(
                        "key-not-found",
                        "There is no {kind} with this id; it may have been withdrawn already.",
                        kind=_LABELS[kind],
                    )
                )
            session.delete(row)
        self.clear_cache()
        return row

    def withdraw_sessions(self, user: str, but: str | None = None) -> None:
        """Revokes all sessions and login links of a user, except the key with the id `but`."""
        with self._sessions.begin() as session:
            session.execute(delete(Key).where(Key.user == user, Key.kind.in_(("session", "link")), Key.id != (but or "")))
        self.clear_cache()

    def clear_cache(self) -> None:
        """Clears the cache; called after keys or users have changed."""
        with self._lock:
            self._version += 1
            self._known = {}


def _caller_of(row: Key, session: Session) -> Caller | None:
    if row.kind == "worker":
        return Caller(row.name, Role.NOBODY, "worker", row.id)
    role = min(Role.from_name(row.role), _role_of(row.user, session))
    if role is Role.NOBODY:
        return None
    return Caller(row.user, role, "session" if row.kind == "session" else "token", row.id)


def _role_of(user: str, session: Session) -> Role:
    if user == OWNER:
        return Role.ADMIN
    found = session.get(User, user)
    return Role.NOBODY if found is None else Role.from_name(found.role)


def _is_valid_clauses(*kinds: KeyKind) -> tuple[ColumnElement[bool], ...]:
    return Key.kind.in_(kinds), or_(Key.expires.is_(None), Key.expires > time.time())


def _has_expired(expires: float | None) -> bool:
    return expires is not None and expires < time.time()
