"""Redis locks without Lua scripts, which a worker's user may not run."""

from __future__ import annotations

from typing import Any

import redis
from redis.exceptions import LockNotOwnedError, WatchError
from redis.lock import Lock

__all__ = ["ScriptlessLock"]


class ScriptlessLock(Lock):
    """redis-py's lock, released in a transaction that fails if the key changes, in place of a script."""

    def register_scripts(self) -> None:
        """Registers none."""

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
