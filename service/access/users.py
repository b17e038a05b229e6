"""Users: their names, roles and passwords."""

from __future__ import annotations

import re
import time

from sqlalchemy import delete, select

from renderer.sentences import Sentence
from service.access.keys import Keys
from service.access.passwords import check_strength, hashed, is_right
from service.access.roles import OPEN, OWNER, Role
from service.errors import Conflict, Invalid, NotFound
from service.store.database import Sessions
from service.store.models import Key, Member, Quota, ShareTerms, User

__all__ = ["Users"]

NAME = re.compile(r"[a-z0-9][a-z0-9._@-]{0,62}")
RESERVED_NAMES = (OWNER, OPEN.name)


class Users:
    """The users in the database. Changes that affect access also end the user's sessions."""

    def __init__(self, sessions: Sessions, keys: Keys) -> None:
        self._sessions = sessions
        self._keys = keys

    def add(self, name: str, role: Role, password: str | None) -> User:
        """Creates a user. Raises Invalid for an invalid name or password, Conflict if the name is taken."""
        if not NAME.fullmatch(name) or name in RESERVED_NAMES:
            raise Invalid(
                Sentence(
                    "user-name-invalid",
                    "{name} cannot be a user's name. Use small letters, digits and . _ @ - (at most 63), and not {owner}.",
                    name=repr(name[:64]),
                    owner=repr(OWNER),
                )
            )
        kept = None if password is None else _checked_hash(password, name)
        user = User(name=name, role=role.api_name, password=kept, created=time.time())
        with self._sessions.begin() as session:
            if session.get(User, name) is not None:
                raise Conflict(
                    Sentence(
                        "user-exists",
                        "There is a user {name} already. Change its role or password, or choose another name.",
                        name=repr(name),
                    )
                )
            session.add(user)
        return user

    def listed(self) -> list[User]:
        """Returns all users, ordered by name."""
        with self._sessions() as session:
            return list(session.scalars(select(User).order_by(User.name)))

    def find(self, name: str) -> User:
        """Returns the user with this name. Raises NotFound."""
        with self._sessions() as session:
            user = session.get(User, name)
        if user is None:
            raise _user_not_found(name)
        return user

    def set_role(self, name: str, role: Role) -> User:
        """Sets a user's role. It takes effect at once, also for open sessions. Raises NotFound."""
        with self._sessions.begin() as session:
            user = session.get(User, name)
            if user is None:
                raise _user_not_found(name)
            user.role = role.api_name
        self._keys.clear_cache()
        return user

    def set_password(self, name: str, password: str, stays: str | None = None) -> User:
        """Sets a user's password and ends all of the user's sessions. stays: id of a session that remains.

        Raises NotFound and Invalid.
        """
        self.find(name)
        kept = _checked_hash(password, name)
        with self._sessions.begin() as session:
            user = session.get(User, name)
            if user is None:
                raise _user_not_found(name)
            user.password = kept
        self._keys.withdraw_sessions(name, stays)
        return user

    def remove(self, name: str) -> None:
        """Deletes a user and all of the user's keys, memberships, quotas and shares, except worker keys."""
        with self._sessions.begin() as session:
            user = session.get(User, name)
            if user is None:
                raise _user_not_found(name)
            session.delete(user)
            session.execute(delete(Key).where(Key.user == name, Key.kind != "worker"))
            session.execute(delete(Member).where(Member.user == name))
            session.execute(delete(Quota).where(Quota.whose == f"user:{name}"))
            session.execute(delete(ShareTerms).where(ShareTerms.name == f"user:{name}"))
        self._keys.clear_cache()

    def log_in(self, name: str, password: str) -> User | None:
        """Returns the user if the password is right, else None.

        An unknown name takes as long to check, so names cannot be probed.
        """
        with self._sessions() as session:
            user = session.get(User, name[:64])
        return user if is_right(password, user.password if user else None) else None


def _checked_hash(password: str, name: str) -> str:
    check_strength(password, name)
    return hashed(password)


def _user_not_found(name: str) -> NotFound:
    return NotFound(Sentence("user-not-found", "There is no user {name}. GET /api/users lists them.", name=repr(name[:64])))
