"""Tests of Redis over TLS for the service, the workers and Celery: a real Redis behind a TLS proxy."""

from __future__ import annotations

import contextlib
import selectors
import socket
import ssl
import threading
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest
import redis
from celery import Celery

from protocol.broker import celery_config
from protocol.redis_tls import CA_VARIABLE, with_certificate_authority, without_local_options
from service.settings import Settings
from tests.worker.exchange.certificates import certificate
from worker.exchange.errors import LinkError
from worker.joining import check_redis


def relay(inside: socket.socket, port: int) -> None:
    """Forwards bytes between a TLS connection and the Redis on this port, until one of them closes."""
    with inside, socket.create_connection(("127.0.0.1", port)) as outside, selectors.DefaultSelector() as ready:
        ready.register(inside, selectors.EVENT_READ, outside)
        ready.register(outside, selectors.EVENT_READ, inside)
        with contextlib.suppress(OSError):
            while True:
                for key, _ in ready.select():
                    data = key.fileobj.recv(1 << 16)  # type: ignore[union-attr]
                    if not data:
                        return
                    key.data.sendall(data)


@pytest.fixture
def over_tls(tmp_path: Path, redis_url: str) -> Iterator[tuple[str, Path]]:
    """Puts a TLS proxy in front of the tests' Redis. Yields the proxy's rediss:// URL and the path of its certificate."""
    authority, key = certificate(tmp_path, "redis", "127.0.0.1")
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(authority, key)
    parts = urlsplit(redis_url)
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def accept() -> None:
            while True:
                try:
                    plain, _ = listening.accept()
                except OSError:
                    return
                with contextlib.suppress(OSError):
                    inside = context.wrap_socket(plain, server_side=True)
                    threading.Thread(target=relay, args=(inside, parts.port), daemon=True).start()

        threading.Thread(target=accept, daemon=True).start()
        port = listening.getsockname()[1]
        yield parts._replace(scheme="rediss", netloc=f":{parts.password}@127.0.0.1:{port}").geturl(), authority
        listening.shutdown(socket.SHUT_RDWR)


def test_redis_certificate_is_verified_by_authority(
    over_tls: tuple[str, Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    url, authority = over_tls
    for wrong in ("", str(certificate(tmp_path, "other", "127.0.0.1")[0])):
        monkeypatch.setenv(CA_VARIABLE, wrong)
        with pytest.raises(LinkError, match="certificate verify failed"):
            check_redis(with_certificate_authority(url))
    monkeypatch.setenv(CA_VARIABLE, str(authority))
    check_redis(with_certificate_authority(url))


def test_celery_and_service_connect_over_tls(over_tls: tuple[str, Path], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    url, authority = over_tls
    monkeypatch.setenv(CA_VARIABLE, str(authority))
    settings = Settings(data=tmp_path, redis_url=url)
    with redis.Redis.from_url(settings.redis_url) as store:
        app = Celery("tests", set_as_current=False)
        app.conf.update(celery_config(settings.redis_url))
        app.send_task("rayfarm.nothing", queue="rayfarm.tests-of-tls")
        assert store.llen("rayfarm.tests-of-tls") == 1
        store.delete("rayfarm.tests-of-tls")
        app.close()


def test_url_for_workers_omits_local_files(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(CA_VARIABLE, "/etc/redis-ca.pem")
    settings = Settings(data=tmp_path, redis_url="rediss://:secret@redis.example:6380/2?health_check_interval=30")
    assert "ssl_ca_certs=/etc/redis-ca.pem" in settings.redis_url
    assert "ssl_cert_reqs=required" in settings.redis_url
    assert settings.worker_redis_url.startswith("rediss://:secret@redis.example:6380/2?")
    assert "redis-ca" not in settings.worker_redis_url
    assert "health_check_interval=30" in settings.worker_redis_url
    plain = "redis://:secret@redis.example:6379/0"
    assert with_certificate_authority(plain) == without_local_options(plain) == plain
