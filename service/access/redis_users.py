"""A Redis user for each worker token, so that revoking the token also ends the worker's access to Redis.

These users exist only in Redis's memory and may access only the keys of the queue and the farm. Their passwords are derived from
the farm's token and the key's id: after a restart of Redis they are created again with the same passwords, and the workers
continue. Redis itself closes the connections of a deleted user.
"""

from __future__ import annotations

import contextlib
import hashlib
import hmac
import logging
import threading
from urllib.parse import urlsplit

import redis
from redis.exceptions import NoPermissionError

from renderer.library_messages import library_message
from renderer.sentences import Sentence
from service.access.keys import Keys
from service.access.redis_care import RedisCare, is_busy
from service.access.secrets import fingerprint
from service.errors import FarmError, Unavailable

__all__ = ["REDIS_6_RULES", "REFRESH_EVERY_S", "RULES", "RedisUsers"]

log = logging.getLogger(__name__)

REFRESH_EVERY_S = 5.0  # seconds between updates, for tokens revoked by other processes, expired tokens, and a restarted Redis
CONNECTION = (
    *("+auth", "+hello", "+ping", "+select", "+quit", "+reset"),
    *("+client|setname", "+client|setinfo", "+client|getname", "+client|id"),
    *("+multi", "+exec", "+discard", "+unwatch"),
)
# Only scripts loaded by the service (service/access/redis_care.py), for workers of older releases.
RULES = (
    *("reset", "on", *CONNECTION),
    # Results and answers: append only.
    "(~rayfarm:results +xadd +xlen)",
    "(~rayfarm:view-answers ~rayfarm:explained:* +rpush +ltrim +expire)",
    # Celery's queues and its bookkeeping.
    "(~rayfarm.* +brpop +rpop +lpush +rpush +llen +pexpire)",
    "(~rayfarm.help.* ~rayfarm:worker:* +del +unlink +exists)",  # a leaving worker deletes both with one DEL
    "(~_kombu.binding* +sadd +srem +smembers)",
    "(~unacked ~unacked_index +hget +hset +hdel +hlen +zadd +zrem +zrange +zrevrangebyscore +watch)",
    "(~unacked_mutex +set +get +del +watch +evalsha)",
    # Workers' reports about themselves and their tasks.
    "(~rayfarm:worker:* ~rayfarm:offer:* ~rayfarm:vitals:* ~rayfarm:log:* ~rayfarm:joining ~rayfarm:deaths:* ~rayfarm:site:* "
    "~rayfarm:site-secret:* +set +setex +get +mget +del +unlink +exists +expire +incr +incrby +ttl)",
    # The service's messages to workers.
    "(~rayfarm:order:* ~rayfarm:terms:* ~rayfarm:log-wanted:* ~rayfarm:view:* ~rayfarm:recall:* +get +mget +exists +ttl)",
)
# For Redis 6.2, in which a user has one list of commands for all keys.
REDIS_6_RULES = (
    *("reset", "on", *CONNECTION),
    *("~rayfarm:*", "~rayfarm.*", "~_kombu.binding*", "~unacked*"),
    *("+@list", "+@set", "+@sortedset", "+@hash", "+@string", "+watch", "+evalsha"),
    *("+del", "+unlink", "+exists", "+expire", "+pexpire", "+ttl", "+pttl", "+type", "+xadd", "+xlen"),
    "-@dangerous",
)


class RedisUsers:
    """Creates and deletes Redis users so that there is exactly one for each valid worker key.

    `trouble`: the reason why Redis does not permit that; None if it does.
    """

    def __init__(self, connection: redis.Redis, keys: Keys, secret: str, instance: str) -> None:
        self._redis = connection
        self._care = RedisCare(connection)
        self._keys = keys
        self._secret = secret
        self._prefix = f"rayfarm-{fingerprint(instance)[:8]}-"  # several farms may share a Redis
        self._lock = threading.Lock()
        self._known: set[str] = set()  # users with this release's rules
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="redis users", daemon=True)
        self.trouble: str | None = None

    def start(self) -> None:
        """Starts the background thread."""
        self._thread.start()

    def stop(self) -> None:
        """Stops the background thread; the Redis users remain, so workers stay connected."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
        self._redis.close()

    def address_for(self, key: str, url: str) -> str:
        """Creates the Redis user of a worker key, and returns `url` with that user's name and password.

        If Redis has no ACL or does not permit its use, logs a warning and returns `url` unchanged. Raises Unavailable after any
        other error: while Redis is busy, full or read-only, a worker must not get the farm's own credentials.
        """
        name = self._prefix + key
        try:
            with self._lock:
                self._set(name)
        except redis.ResponseError as error:
            if not (isinstance(error, NoPermissionError) or "unknown command" in str(error).lower()):
                raise Unavailable(
                    Sentence(
                        "redis-user-not-created",
                        "Redis cannot create a user for this worker ({error}). It will be retried.",
                        error=library_message(error),
                    )
                ) from None
            self._warn(error)
            return url
        except (redis.RedisError, OSError) as error:
            raise Unavailable(
                Sentence(
                    "redis-silent-retrying", "Redis does not answer ({error}). It will be retried.", error=library_message(error)
                )
            ) from None
        parts = urlsplit(url)
        return parts._replace(netloc=f"{name}:{self._password(name)}@{parts.netloc.rpartition('@')[2]}").geturl()

    def refresh(self) -> None:
        """Creates the Redis users of all valid worker keys, and deletes all other worker users.

        Raises redis.RedisError and FarmError.
        """
        with self._lock:
            wanted = {self._prefix + key.id for key in self._keys.listed("worker")}
            there = {name for name in map(_text, self._redis.acl_users()) if name.startswith(self._prefix)}
            for name in there - wanted:
                self._redis.acl_deluser(name)
            for name in wanted - (there & self._known):
                self._set(name)
            self._known = wanted
        self.trouble = None

    def refresh_now(self) -> None:
        """Updates the Redis users at once, after a key was revoked. Ignores errors: the periodic update retries."""
        with contextlib.suppress(redis.RedisError, FarmError, OSError):
            self.refresh()

    def _set(self, name: str) -> None:
        try:
            self._redis.execute_command("ACL SETUSER", name, *RULES, f">{self._password(name)}")
        except redis.ResponseError as error:
            if "modifier" not in str(error):
                raise
            self._redis.execute_command("ACL SETUSER", name, *REDIS_6_RULES, f">{self._password(name)}")
        self._known.add(name)

    def _password(self, name: str) -> str:
        return hmac.new(self._secret.encode(), f"redis {name}".encode(), hashlib.sha256).hexdigest()

    def _run(self) -> None:
        while True:
            try:
                self.refresh()
            except redis.ResponseError as error:
                if is_busy(error):
                    self._unblock()
                else:
                    self._warn(error)
            except (redis.RedisError, FarmError, OSError) as error:
                log.debug("the Redis users of workers cannot be updated: %s", error)
            with contextlib.suppress(redis.RedisError, OSError):
                self._care.maintain()
            if self._stop.wait(REFRESH_EVERY_S):
                return

    def _unblock(self) -> None:
        with contextlib.suppress(redis.RedisError, OSError):
            self._care.unblock()

    def _warn(self, error: Exception) -> None:
        if self.trouble is None:
            log.warning("Redis cannot create users for workers (%s): all workers share one password, even revoked ones", error)
        self.trouble = str(error)


def _text(name: bytes | str) -> str:
    return name.decode(errors="replace") if isinstance(name, bytes) else name
