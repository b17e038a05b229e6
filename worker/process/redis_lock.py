"""Redis locks without Lua scripts, since a worker's Redis user may not run any."""

from __future__ import annotations

from typing import Any

import redis
from redis.exceptions import LockNotOwnedError, WatchError
from redis.lock import Lock

__all__ = ["ScriptlessLock"]


class ScriptlessLock(Lock):
    """redis-py's lock, but released in a transaction, which fails if the key changes, instead of a script."""

    def register_scripts(self) -> None:
        """Registers no scripts."""

    def do_release(self, expected_token: Any) -> None:
        """Deletes the key if it holds this lock's token. Raises LockNotOwnedError otherwise."""
        client: redis.Redis = self.redis
        with client.pipeline() as transaction:
            try:
                transaction.watch(self.name)
                if transaction.get(self.name) != expected_token:
                    raise LockNotOwnedError("The lock is no longer owned.", lock_name=str(self.name))
                transaction.multi()
                transaction.delete(self.name)
                transaction.execute()
            except WatchError:
                raise LockNotOwnedError("The lock was taken over.", lock_name=str(self.name)) from None
