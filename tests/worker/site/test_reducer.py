"""Tests of a site's reducer process: it adds up workers' sums, authenticates workers, and its successor sends its sums."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from http.client import HTTPConnection
from http.server import ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest
import redis

from protocol.contract import RESULTS, Result
from protocol.result_bytes import result_bytes
from protocol.site import SIGNATURE_HEADER, SUMS_PATH, secret_key, signature, site_key
from protocol.sums import unpack_sums
from rayfarm.local.farm import free_port
from tests.grids import grid
from tests.helpers import wait_until
from tests.reducer import ReducerProcess
from tests.worker.bench import FakeService
from tests.worker.site.test_sums import SUMS, TILE, sums
from worker.site import reducer as reducer_module
from worker.site.link import SiteLink
from worker.site.reducer import MAX_INCOMING_BYTES, MAX_RESULT_BYTES


@pytest.fixture
def service(redis_url: str, store: redis.Redis) -> Iterator[str]:
    handler = type("Handler", (FakeService,), {"redis_url": redis_url})
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()


def arrived(store: redis.Redis, many: int) -> list[Result]:
    wait_until(lambda: int(store.xlen(RESULTS)) >= many, 30, f"{many} results arrive")
    found = [Result.from_fields(fields) for _, fields in store.xrange(RESULTS)]
    store.delete(RESULTS)
    return found


def test_results_are_merged_despite_killed_processes(service: str, store: redis.Redis, redis_url: str, tmp_path: Path) -> None:
    port = free_port("127.0.0.1")
    reducing = ReducerProcess(store, service, "token", tmp_path, port=port)
    link, another = SiteLink(redis_url), SiteLink(redis_url)
    assert link.send(sums(0, 4, "alpha"))
    assert link.send(sums(4, 8, "beta"))
    (one,) = arrived(store, 1)
    assert [part[4] for part in one.event["parts"]] == ["alpha", "beta"]
    assert one.event["worker"] == "site attic"
    assert np.array_equal(unpack_sums(one.sums or b"", TILE), 12 * SUMS)

    long = 1e9  # the maximum time
    assert all(each.send(sums(0, 4, run=["attic", 0, 12, long])) for each in (link, another))
    wait_until(lambda: (r := reducing.report()) is not None and r.in_hand == ["b0"], 20, "it says what it has")
    reducing.kill()
    assert not link.send(sums(4, 4)), "its worker sends by itself"
    reducing = ReducerProcess(store, service, "token", tmp_path, port=port)
    (left,) = arrived(store, 1)
    assert (left.event["first"], left.event["count"]) == (0, 4)

    assert another.send(sums(0, 4, run=["attic", 0, 12, long])), "it looks up what to sign with now"
    assert reducing.stop() == 0
    assert len(arrived(store, 1)) == 1
    assert not store.exists(site_key("attic"), secret_key("attic"))
    assert not another.send(sums(0, 4))


@pytest.mark.long
def test_second_reducer_leaves_sums_of_first(service: str, store: redis.Redis, redis_url: str, tmp_path: Path) -> None:
    reducing = ReducerProcess(store, service, "token", tmp_path)
    try:
        patient = {"run": ["attic", 0, 12, 1e9]}
        assert SiteLink(redis_url).send(sums(0, 4, **patient))
        with pytest.raises(AssertionError, match="has a reducer on this machine already"):
            ReducerProcess(store, service, "token", tmp_path)
        assert SiteLink(redis_url).send(sums(4, 8, **patient))
        (whole,) = arrived(store, 1)
        assert whole.event["count"] == 12
    finally:
        reducing.kill()


@pytest.mark.long
def test_only_signed_requests_are_accepted(service: str, store: redis.Redis, redis_url: str, tmp_path: Path) -> None:
    reducing = ReducerProcess(store, service, "token", tmp_path)
    try:
        report, secret = reducing.report(), store.get(secret_key("attic"))
        assert report is not None
        assert isinstance(secret, bytes)

        def post(body: bytes, signed: str, path: str = SUMS_PATH) -> int:
            connection = HTTPConnection("127.0.0.1", report.port, timeout=20)
            connection.request("POST", path, body, {SIGNATURE_HEADER: signed})
            status = connection.getresponse().status
            connection.close()
            return status

        body = result_bytes(sums(0, 4))
        assert post(body, "") == post(body, signature(b"another", body)) == post(body + b"!", signature(secret, body)) == 403
        assert post(body, "\xe9") == 403, "no signature is of such letters"
        assert post(body, signature(secret, body), "/") == 404
        assert post(b"no result", signature(secret, b"no result")) == 409
        with ExitStack() as held:  # clients that announce so many bytes and send none

            def hold() -> None:
                wire = held.enter_context(socket.create_connection(("127.0.0.1", report.port), timeout=20))
                wire.sendall(f"POST {SUMS_PATH} HTTP/1.1\r\nContent-Length: {MAX_RESULT_BYTES}\r\n\r\n".encode())

            def is_full() -> bool:
                if post(body, signature(secret, body)) == 503:
                    return True
                hold()  # a connection made meanwhile found no room and was closed
                return False

            for _ in range(MAX_INCOMING_BYTES // MAX_RESULT_BYTES):
                hold()
            wait_until(is_full, 20, "there is room for no more")
            assert SiteLink(redis_url).send(sums(4, 4)), "but for who says that it belongs here"
        wait_until(lambda: post(body, signature(secret, body)) == 204, 30, "they have left, and there is room again")
    finally:
        reducing.kill()


def test_slow_clients_are_disconnected_and_limited_in_number(monkeypatch: pytest.MonkeyPatch) -> None:
    """Checks that clients that send single bytes are disconnected after a time limit, and that an address has few connections.

    Afterwards another client is served.
    """
    monkeypatch.setattr(reducer_module, "PATIENCE_S", 0.5)
    monkeypatch.setattr(reducer_module, "MOST_OF_ONE", 4)
    server = reducer_module._Server(("127.0.0.1", 0), reducer_module._Handler)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    stop = threading.Event()
    with ExitStack() as held:
        wires = [held.enter_context(socket.create_connection(server.server_address, timeout=20)) for _ in range(4)]  # type: ignore[arg-type]

        def trickle() -> None:
            while not stop.wait(0.05):
                for wire in wires:
                    with suppress(OSError):
                        wire.send(b"X")

        trickling = threading.Thread(target=trickle)
        trickling.start()
        try:
            wait_until(lambda: len(server._here) == 4, 20, "all are let in")
            begun = time.monotonic()
            with socket.create_connection(server.server_address, timeout=20) as fifth:  # type: ignore[arg-type]
                assert is_closed_by_peer(fifth), "there is room for no more of this address"
            assert all(map(is_closed_by_peer, wires))
            assert time.monotonic() - begun < 15.0
            wait_until(lambda: not server._here, 20, "their room is free")
        finally:
            stop.set()
            trickling.join()
    with socket.create_connection(server.server_address, timeout=20) as next_one:  # type: ignore[arg-type]
        next_one.sendall(b"POST /elsewhere HTTP/1.1\r\nContent-Length: 0\r\n\r\n")
        assert next_one.recv(100).startswith(b"HTTP/1.0 404")
    server.shutdown()
    server.server_close()
    thread.join()


def is_closed_by_peer(wire: socket.socket) -> bool:
    """Returns True if the other end closes the connection instead of sending a byte. Raises TimeoutError if it does neither."""
    with suppress(ConnectionError):
        return not wire.recv(1)
    return True


def test_result_without_run_goes_to_service(redis_url: str) -> None:
    result = sums(0, 4)
    del result.event["run"]
    assert not SiteLink(redis_url).send(result)


@pytest.mark.long
@grid(
    ("token", "reduces", "said"),
    [("wrong", True, "does not know this token"), ("token", False, "older release")],
    ordinary=("wrong",),
)
def test_rejected_reducer_exits_with_message(
    redis_url: str, store: redis.Redis, tmp_path: Path, token: str, reduces: bool, said: str
) -> None:
    handler = type("Handler", (FakeService,), {"redis_url": redis_url, "reduces": reduces})
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    with pytest.raises(AssertionError, match=said):
        ReducerProcess(store, f"http://127.0.0.1:{server.server_port}", token, tmp_path)
    server.shutdown()
    server.server_close()
