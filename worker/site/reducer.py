"""`python -m worker.site.reducer --service URL --name SITE`: adds up the results of a site's machines for each tile.

The reducer sends the results of consecutive samples to the service as one result. `rayfarm site` starts a reducer. If results
are lost with it, they are rendered again. Workers that cannot reach it send to the service directly.
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import io
import logging
import os
import secrets
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import redis

from protocol.contract import HEARTBEAT_EVERY_S, HEARTBEAT_TTL_S, Result
from protocol.redis_tls import with_certificate_authority
from protocol.result_bytes import result_of
from protocol.site import (
    ANNOUNCED_HEADER,
    SECRET_S,
    SIGNATURE_HEADER,
    SITE_NAME,
    SUMS_PATH,
    SiteReport,
    secret_key,
    signature,
    site_key,
    size_signature,
)
from renderer.printable import printable
from renderer.variables import VariableError, value_of
from telemetry.log_lines import FORMAT_VARIABLE, FORMATS, uses_json
from worker.exchange.errors import LinkError, RefusedError, TemporaryError, WorkerError
from worker.exchange.link import FarmAnswer, Link
from worker.exchange.results import ResultStream
from worker.site.socket_deadline import DeadlineReader
from worker.site.sums import SiteSums, SumsFullError
from worker.telemetry import logs

__all__ = ["Reducer", "main"]

EXIT_REFUSED = 3
LOOK_EVERY_S = 0.05
MAX_RESULT_BYTES = 64 << 20  # bytes of a result
MAX_STORED_BYTES = 1 << 30  # that wait here
MAX_INCOMING_BYTES = 8 * MAX_RESULT_BYTES  # limit of bytes being received from workers, and of bytes from unidentified senders
MOST_AT_ONCE, MOST_OF_ONE = 1024, 256  # connections, and of them of one address
FIRST_PAUSE_S, LAST_PAUSE_S = 0.2, 3.0
PATIENCE_S = 10.0  # timeout of a sender's header, and of a small body
MIN_RATE = 1 << 20  # minimum bytes per second of larger bodies

log = logging.getLogger("worker")


class Reducer:
    """Receives results from workers in many threads, and sends their sums to the service from one."""

    def __init__(self, name: str, sums: SiteSums, redis_url: str) -> None:
        self.name = name
        self.sums = sums
        self.results = self.sent = self.bytes_in = self.bytes_out = 0
        self._stream = ResultStream(redis_url)
        self._store = redis.Redis.from_url(redis_url, socket_timeout=2, socket_connect_timeout=2)
        self._secrets: list[tuple[float, bytes]] = []  # the newest first, and since when
        self._started = time.time()
        self._coming = [0, 0]  # bytes being received: from unidentified senders, and from workers
        self._count = threading.Lock()

    def is_signed(self, body: bytes, claimed: str) -> bool:
        """Returns True if `claimed` is a worker's valid signature of this body (protocol/site.py)."""
        return any(secrets.compare_digest(signature(secret, body).encode(), claimed.encode()) for _, secret in self._secrets)

    def is_announced(self, size: int, signature: str) -> bool:
        """Returns True if `signature` is a worker's valid signature of the body's size, which is sent before the body."""
        return any(
            secrets.compare_digest(size_signature(secret, size).encode(), signature.encode()) for _, secret in self._secrets
        )

    @contextlib.contextmanager
    def reserve_memory(self, size: int, is_ours: bool = False) -> Iterator[bool]:
        """Context manager that reserves memory for a request's body; yields False if the limit is reached.

        is_ours: whether the size is signed by a worker of the farm. Other senders have a limit of their own.
        """
        with self._count:
            is_there = self._coming[is_ours] + size <= MAX_INCOMING_BYTES
            self._coming[is_ours] += size if is_there else 0
        try:
            yield is_there
        finally:
            with self._count:
                self._coming[is_ours] -= size if is_there else 0

    def store(self, body: bytes) -> None:
        """Stores a result until it is sent. Raises ValueError if it is invalid, SumsFullError if the store is full, or OSError.

        body: the result as protocol/result_bytes.py packs it.
        """
        self.sums.store(result_of(body))
        with self._count:
            self.results += 1
            self.bytes_in += len(body)

    def send_due(self, at_once: bool = False) -> None:
        """Sends the sums that are complete or have waited too long. at_once: sends all sums."""
        for results in self.sums.due_results(at_once):
            for result in results:
                self._stream.send(Result({**result.event, "worker": f"site {self.name}"}, result.sums))
                self.sent += 1
                self.bytes_out += len(result.sums or b"")

    def report(self, address: str, port: int) -> None:
        """Publishes this reducer's address, report and signing key in Redis. Raises redis.RedisError."""
        now = time.monotonic()
        if not self._secrets or now - self._secrets[0][0] > SECRET_S:
            self._secrets = [(now, secrets.token_bytes(32)), *self._secrets[:1]]
        counts = (self.results, self.sent, self.bytes_in, self.bytes_out)
        about = (self.name, socket.gethostname(), os.getpid(), address, port, self._started, self.sums.batches_in_hand(), *counts)
        with self._store.pipeline(transaction=False) as both:
            both.set(secret_key(self.name), self._secrets[0][1], ex=HEARTBEAT_TTL_S)
            both.set(site_key(self.name), SiteReport(*about).to_bytes(), ex=HEARTBEAT_TTL_S)
            both.execute()

    def withdraw(self) -> None:
        """Deletes the data that `report` published in Redis, so that workers send their sums to the service."""
        with contextlib.suppress(redis.RedisError):
            self._store.delete(site_key(self.name), secret_key(self.name))


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    request_queue_size = 512  # all machines of a site may come at once
    reducer: Reducer

    def __init__(self, *about: Any) -> None:
        super().__init__(*about)
        self._here: dict[int, str] = {}  # whose connections there are
        self._lock = threading.Lock()

    def verify_request(self, request: Any, client_address: Any) -> bool:
        """Returns False above the limit of connections, in total or from one address, since each takes a thread."""
        who = str(client_address[0])
        with self._lock:
            here = list(self._here.values())
            if len(here) >= MOST_AT_ONCE or here.count(who) >= MOST_OF_ONE:
                return False
            self._here[id(request)] = who
        return True

    def shutdown_request(self, request: Any) -> None:
        """Frees a request's thread when it ends."""
        with self._lock:
            self._here.pop(id(request), None)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignores errors of broken connections: the sender then sends its result to the service."""
        log.debug("a connection from %s was lost", client_address, exc_info=True)


class _Handler(BaseHTTPRequestHandler):
    server: _Server

    def setup(self) -> None:
        """Sets a time limit for reading the request."""
        super().setup()
        self.rfile.close()
        self._timed = DeadlineReader(self.connection, PATIENCE_S)
        self.rfile = io.BufferedReader(self._timed, 1 << 16)

    def do_POST(self) -> None:
        try:
            size = int(self.headers.get("Content-Length", ""))
        except ValueError:
            return self._send_status(HTTPStatus.LENGTH_REQUIRED)
        if self.path != SUMS_PATH or not 0 <= size <= MAX_RESULT_BYTES:
            return self._send_status(HTTPStatus.NOT_FOUND if self.path != SUMS_PATH else HTTPStatus.REQUEST_ENTITY_TOO_LARGE)
        is_ours = self.server.reducer.is_announced(size, self.headers.get(ANNOUNCED_HEADER, ""))
        with self.server.reducer.reserve_memory(size, is_ours) as is_there:
            if not is_there:
                return self._send_status(HTTPStatus.SERVICE_UNAVAILABLE)
            self._timed.set_deadline(PATIENCE_S + size / MIN_RATE)
            return self._store_body(self.rfile.read(size), size)

    def _store_body(self, body: bytes, size: int) -> None:
        if len(body) != size:
            return None
        if not self.server.reducer.is_signed(body, self.headers.get(SIGNATURE_HEADER, "")):
            return self._send_status(HTTPStatus.FORBIDDEN)
        try:
            self.server.reducer.store(body)
        except ValueError as error:
            log.debug("sums are rejected and left to the service: %s", error)
            return self._send_status(HTTPStatus.CONFLICT)
        except (SumsFullError, OSError) as error:
            log.warning("sums are not taken: %s", error or "too many wait")
            return self._send_status(HTTPStatus.SERVICE_UNAVAILABLE)
        return self._send_status(HTTPStatus.NO_CONTENT)

    def _send_status(self, status: HTTPStatus) -> None:
        self.close_connection = True
        self.connection.settimeout(PATIENCE_S)
        self.send_response(status)
        self.send_header("Content-Length", "0")
        self.end_headers()

    def log_message(self, format: str, *arguments: Any) -> None:
        """Logs nothing, since workers report failures."""


def main() -> int:
    """Runs the reducer until a signal. Returns the exit code.

    Exit code 3: the address is not that of a farm, or the farm rejects this reducer, so a restart does not help.
    """
    options = _options()
    if options.log_format:
        os.environ[FORMAT_VARIABLE] = options.log_format
    logs.set_up()
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    try:
        options.token = options.token or value_of("RAYFARM_TOKEN")
        return _run_reducer(options, stop)
    except (WorkerError, VariableError) as error:
        log.error("%s", error) if uses_json() else print(printable(f"rayfarm site: {error}"), file=sys.stderr)
        return EXIT_REFUSED


def _run_reducer(options: argparse.Namespace, stop: threading.Event) -> int:
    if not SITE_NAME.fullmatch(options.name):
        raise RefusedError(f"{options.name!r} is not a site name; use lower-case letters, digits and . _ -")
    farm = _join_farm(Link(options.service, options.token), stop)
    if farm is None:
        return 0
    folder = options.folder / options.name
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        alone = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)  # held until this process ends, however that is
        fcntl.flock(alone, fcntl.LOCK_EX | fcntl.LOCK_NB)
        server = _Server((options.host, options.port), _Handler)
        reducer = Reducer(options.name, SiteSums(folder, MAX_STORED_BYTES), with_certificate_authority(farm.redis_url))
    except BlockingIOError:
        raise RefusedError(f"The site {options.name} has a reducer on this machine already. One of them is enough.") from None
    except OSError as error:
        raise RefusedError(f"It cannot begin: {error}. Look at --port, and whether {options.folder} can be written.") from None
    server.reducer = reducer
    address = options.address or _own_address(options.service)
    threading.Thread(target=server.serve_forever, name="sums", daemon=True).start()
    beating = threading.Thread(target=_report_until_stopped, args=(reducer, address, server.server_port, stop), name="beat")
    beating.start()
    log.info("adding up sums of the site %s at %s:%d", options.name, address, server.server_port)
    while not stop.wait(LOOK_EVERY_S):
        _send(reducer)
    beating.join()
    server.shutdown()
    _send(reducer, at_once=True)
    return 0


def _send(reducer: Reducer, at_once: bool = False) -> None:
    try:
        reducer.send_due(at_once)
    except OSError as error:
        log.warning("sums are lost, and will be rendered again: %s", error)


def _report_until_stopped(reducer: Reducer, address: str, port: int, stop: threading.Event) -> None:
    said = ""
    while True:
        try:
            reducer.report(address, port)
            said = ""
        except redis.RedisError as error:
            if str(error) != said:
                said = str(error)
                log.warning("Redis does not answer: %s", error)
        if stop.wait(HEARTBEAT_EVERY_S):
            reducer.withdraw()
            return


def _join_farm(link: Link, stop: threading.Event) -> FarmAnswer | None:
    """Joins the farm once the service is reachable; returns None if `stop` is set.

    Raises WorkerError if a retry does not help.
    """
    pause, said = FIRST_PAUSE_S, ""
    while not stop.is_set():
        try:
            farm = link.join()
            if not farm.reduces:
                raise RefusedError(
                    f"{link.service} is an older release, which does not accept sums of a site. Upgrade it to this release."
                )
            return farm
        except LinkError as error:
            if str(error) != said:
                said = str(error)
                log.info("waiting: %s", said)
            stop.wait(pause)
            pause = min(pause * 1.5, LAST_PAUSE_S)
        except TemporaryError as error:
            raise RefusedError(str(error)) from None
    return None


def _own_address(service: str) -> str:
    """Returns the IP address of this machine on its route to the service."""
    url = urlsplit(service)
    with contextlib.suppress(OSError):
        family, kind, _, _, where = socket.getaddrinfo(url.hostname, url.port or 80, type=socket.SOCK_DGRAM)[0]
        with socket.socket(family, kind) as asked:
            asked.connect(where)
            return str(asked.getsockname()[0])
    return socket.gethostname()


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m worker.site.reducer", description="A site's reducer, as `rayfarm site` starts it."
    )
    parser.add_argument("--service", required=True, help="the service's address, as http://host:8000")
    parser.add_argument("--token", default="", help="a worker's token; $RAYFARM_TOKEN, or the file $RAYFARM_TOKEN_FILE")
    parser.add_argument("--name", required=True, help="the site's; its workers are started with --site NAME")
    parser.add_argument("--host", default="0.0.0.0", help="address to listen on (default: all interfaces)")
    parser.add_argument("--port", type=int, default=8010, help="0: any that is free")
    parser.add_argument(
        "--address", default="", help="address by which workers reach it (default: that of this machine on its route to the farm)"
    )
    parser.add_argument("--folder", type=Path, required=True, help="where sums lie until they are sent")
    parser.add_argument("--log-format", choices=FORMATS, help=f"json: each line of the log an object; ${FORMAT_VARIABLE}")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
