"""Tests of the Redis user that each worker with its own token gets: its address, its permissions and its revocation."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from unittest.mock import MagicMock

import httpx
import pytest
import redis
from redis.exceptions import NoPermissionError

from service.access.keys import Keys
from service.access.redis_care import RedisCare
from service.access.redis_users import RedisUsers
from service.access.roles import OWNER, Role
from service.errors import Unavailable
from tests.helpers import running_redis
from tests.service.conftest import TOKEN, Service, until
from worker.process.redis_lock import ScriptlessLock


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis) -> Iterator[Service]:
    service = Service(tmp_path_factory.mktemp("users") / "data", redis_server)
    yield service
    service.stop()


def join_farm(service: Service, token: str) -> redis.Redis:
    answer = httpx.get(f"{service.url}/api/farm/join", headers={"Authorization": f"Bearer {token}"}).raise_for_status()
    return redis.Redis.from_url(answer.json()["redis_url"], retry=None)


def create_token(service: Service, **asked: object) -> dict[str, str]:
    shown = {"Authorization": f"Bearer {(service.options['data'] / 'owner-token').read_text().strip()}"}
    answer = service.http.post("/api/tokens", json={"name": "attic", "role": "worker", **asked}, headers=shown)
    assert answer.status_code == 201, answer.text
    return answer.json()


def is_refused(connection: redis.Redis) -> bool:
    try:
        connection.ping()
    except redis.AuthenticationError:
        return True
    except redis.ConnectionError:
        return False  # closed; the next check finds out whether access is granted again
    return False


def revoke_token(service: Service, id: str) -> None:
    shown = {"Authorization": f"Bearer {(service.options['data'] / 'owner-token').read_text().strip()}"}
    assert service.http.delete(f"/api/tokens/{id}", headers=shown).status_code == 204


def test_redis_user_may_access_only_worker_keys(service: Service) -> None:
    with join_farm(service, create_token(service)["secret"]) as store:
        assert store.xadd("rayfarm:results", {"event": '{"type": "wake"}'})
        assert store.set("rayfarm:worker:attic-tested", b"", ex=1)
        assert store.delete("rayfarm:worker:attic-tested", "rayfarm.help.attic-tested") == 1
        with store.lock("unacked_mutex", timeout=5, lock_class=ScriptlessLock):
            assert store.sadd("_kombu.binding_permanent.rayfarm.render.some-kind", "x") == 1
        for refused in (
            *(["KEYS", "*"], ["FLUSHALL"], ["CONFIG", "GET", "requirepass"], ["ACL", "LIST"], ["SHUTDOWN"], ["GET", "other"]),
            *(["XREAD", "STREAMS", "rayfarm:results", "0"], ["XRANGE", "rayfarm:results", "-", "+"], ["EVAL", "return 1", "0"]),
            *(["XTRIM", "rayfarm:results", "MAXLEN", "0"], ["DEL", "rayfarm:results"], ["SET", "rayfarm.render.kind", "x"]),
            *(["SCRIPT", "LOAD", "return 1"], ["SET", "rayfarm:order:other", "x"], ["FUNCTION", "LIST"], ["MONITOR"]),
            *(
                ["CLIENT", "LIST"],
                ["CLIENT", "KILL", "TYPE", "normal"],
                ["LRANGE", "rayfarm.render.x", "0", "1"],
            ),
        ):
            with pytest.raises(NoPermissionError):
                store.execute_command(*refused)


def test_revoked_token_closes_redis_connections(service: Service) -> None:
    token, other = create_token(service), create_token(service)
    with join_farm(service, token["secret"]) as store, join_farm(service, other["secret"]) as stays:
        assert store.ping()
        assert stays.ping()
        revoke_token(service, token["id"])
        with pytest.raises(redis.ConnectionError):
            store.ping()
        assert is_refused(store)
        assert stays.ping()


@pytest.mark.long
def test_expired_token_closes_redis_connections(service: Service) -> None:
    with join_farm(service, create_token(service, days=4 / 86400)["secret"]) as store:
        assert store.ping()
        until(lambda: is_refused(store), "it is over")


@pytest.mark.long
def test_redis_restart_restores_users(service: Service, redis_server: running_redis) -> None:
    with join_farm(service, create_token(service)["secret"]) as store:
        assert store.ping()
        redis_server.stop()
        redis_server.start()
        until(lambda: not is_refused(store) and bool(store.ping()), "Redis knows it again")


def test_farm_token_gets_farm_password(service: Service) -> None:
    answer = httpx.get(f"{service.url}/api/farm/join", headers={"Authorization": f"Bearer {TOKEN}"}).raise_for_status()
    assert answer.json()["redis_url"] == service.options["redis_url"]


def test_without_acl_all_workers_get_farm_password(service: Service) -> None:
    with redis.Redis.from_url(service.options["redis_url"]) as store:
        store.execute_command("ACL SETUSER", "limited", "on", ">limited", "~*", "+@all", "-acl")
        port = store.connection_pool.connection_kwargs["port"]
        limited = redis.Redis(port=port, username="limited", password="limited")
        users = RedisUsers(limited, service.farm.access.keys, TOKEN, "another instance")
        assert users.address_for("1", "redis://:shared@host:1/0") == "redis://:shared@host:1/0"
        assert "acl" in str(users.trouble)
        store.acl_deluser("limited")
        limited.close()


@pytest.mark.parametrize(
    "answer",
    [
        redis.BusyLoadingError("loading"),
        redis.OutOfMemoryError("OOM"),
        redis.ReadOnlyError("READONLY"),
        redis.ResponseError("BUSY"),
    ],
)
def test_other_redis_errors_never_give_farm_password(service: Service, answer: Exception) -> None:
    store = MagicMock()
    store.execute_command.side_effect = answer
    users = RedisUsers(store, service.farm.access.keys, TOKEN, "another instance")
    with pytest.raises(Unavailable):
        users.address_for("1", "redis://:shared@host:1/0")


def test_farms_sharing_redis_keep_their_users(service: Service) -> None:
    keys = Keys(service.farm.sessions)
    with redis.Redis.from_url(service.options["redis_url"]) as store:
        key = keys.create("worker", OWNER, Role.NOBODY, "shared")[1].id
        names = []
        for instance in ("one", "two"):
            users = RedisUsers(store, keys, TOKEN, instance)
            users.refresh()
            names += [name for name in store.acl_users() if key in name and name.startswith(users._prefix)]
        assert len(names) == 2
        keys.withdraw("worker", key)
        users.refresh()
        assert [name in store.acl_users() for name in names] == [True, False]
        store.acl_deluser(names[0])


def test_redis_url_of_worker_keeps_scheme_host_and_options(service: Service) -> None:
    url = service.farm.redis_users.address_for("12", "rediss://:secret@redis.example:6380/3?x=1")
    assert url.startswith("rediss://rayfarm-")
    assert url.endswith("@redis.example:6380/3?x=1")
    assert "secret" not in url


def test_lock_script_of_older_workers_is_loaded(service: Service) -> None:
    service.farm.redis_users.refresh()
    RedisCare(service.farm.redis_users._redis).maintain()
    with join_farm(service, create_token(service)["secret"]) as store, store.lock("unacked_mutex", timeout=5):
        pass


def test_endless_script_is_killed(service: Service) -> None:
    with (
        redis.Redis.from_url(service.options["redis_url"]) as store,
        redis.Redis.from_url(service.options["redis_url"], socket_timeout=60) as other,
        ThreadPoolExecutor(1) as pool,
    ):
        endless = pool.submit(other.eval, "while true do end", 0)
        with pytest.raises(redis.ResponseError, match="killed"):
            endless.result(timeout=60)
        assert store.ping()


def test_keys_of_wrong_type_are_deleted(service: Service) -> None:
    with redis.Redis.from_url(service.options["redis_url"]) as store:
        store.set("rayfarm.render.mistaken", b"text")
        store.rpush("rayfarm:worker:mistaken", b"text")
        RedisCare(store).maintain()
        assert not store.exists("rayfarm.render.mistaken", "rayfarm:worker:mistaken")


def test_connections_of_a_worker_that_fill_redis_are_closed(service: Service) -> None:
    """A transaction that is never executed uses Redis's memory, but no key."""
    with (
        redis.Redis.from_url(service.options["redis_url"]) as store,
        join_farm(service, create_token(service)["secret"]) as worker,
    ):
        before = store.config_get("maxmemory")["maxmemory"]
        store.config_set("maxmemory", int(store.info("memory")["used_memory"]) + (32 << 20))
        connection = worker.connection_pool.get_connection()
        try:
            connection.send_command("MULTI")
            connection.read_response()
            for _ in range(24):
                connection.send_command("SET", "rayfarm:log:mine", b"x" * (1 << 20), "EX", "60")
                connection.read_response()
            RedisCare(store).maintain()
            with pytest.raises(redis.ConnectionError):
                connection.send_command("PING")
                connection.read_response()
            assert int(store.info("memory")["used_memory"]) < int(store.config_get("maxmemory")["maxmemory"]) / 2
        finally:
            store.config_set("maxmemory", before)


def test_worker_filling_redis_is_disconnected(service: Service) -> None:
    """A worker that fills Redis with large or many keys is disconnected, while other workers' keys stay."""
    with (
        redis.Redis.from_url(service.options["redis_url"]) as store,
        join_farm(service, create_token(service)["secret"]) as worker,
    ):
        before = store.config_get("maxmemory")["maxmemory"]
        store.config_set("maxmemory", int(store.info("memory")["used_memory"]) + (32 << 20))
        try:
            store.set("rayfarm:terms:kept", b"x" * 1000)
            with pytest.raises(redis.OutOfMemoryError):
                for number in range(100_000):
                    worker.set(f"rayfarm:log:{number}", b"x" * (100_000 if number % 2 else 1000))
                    worker.lpush("rayfarm.render.flood", b"x" * 10_000)
            with pytest.raises(redis.OutOfMemoryError):
                store.set("rayfarm:order:some", b"x" * 100_000)
            until(lambda: bool(_stored(store)), "there is room again")
            assert store.get("rayfarm:terms:kept") == b"x" * 1000
        finally:
            store.config_set("maxmemory", before)
            store.delete("rayfarm:terms:kept", "rayfarm:order:some")


def _stored(store: redis.Redis) -> bool:
    try:
        return bool(store.set("rayfarm:order:some", b"x" * 100_000))
    except redis.OutOfMemoryError:
        return False


def test_worker_opening_all_connections_is_disconnected(service: Service) -> None:
    with redis.Redis.from_url(service.options["redis_url"]) as store:
        before = store.config_get("maxclients")["maxclients"]
        store.config_set("maxclients", 60)
        with join_farm(service, create_token(service)["secret"]) as worker:
            pool, held = worker.connection_pool, []
            try:
                with contextlib.suppress(redis.ConnectionError):  # refused, or closed already
                    for _ in range(60):
                        held.append(pool.get_connection())
                        held[-1].send_command("PING")
                        held[-1].read_response()
                assert len(held) > 15
                until(lambda: int(store.info("clients")["connected_clients"]) < 30, "they are closed")
            finally:
                store.config_set("maxclients", before)
                for connection in held:
                    connection.disconnect()
