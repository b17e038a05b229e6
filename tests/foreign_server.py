"""Real server on this machine that is no farm: it sends the same response to every request."""

from __future__ import annotations

import json
import socketserver
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

__all__ = ["EMPTY", "HTML", "NOT_A_FARM", "foreign_server", "http_answer", "json_answer"]


def http_answer(body: bytes, content_type: str = "application/json", status: str = "200 OK", length: int | None = None) -> bytes:
    """Returns a complete HTTP response as bytes. length: value of Content-Length, if not the body's true length."""
    head = f"HTTP/1.1 {status}\r\nContent-Type: {content_type}\r\nContent-Length: {len(body) if length is None else length}\r\n"
    return head.encode() + b"Connection: close\r\n\r\n" + body


HTML = http_answer(b"<!DOCTYPE html><title>Welcome to nginx!</title>", "text/html")
EMPTY = http_answer(b"", "text/plain")

# Servers that a mistyped address may reach, with their response and the words that identify them in the error.
NOT_A_FARM: dict[str, tuple[bytes, str]] = {
    "html": (HTML, "an HTML page"),
    "empty": (EMPTY, "answer is empty"),
    "binary": (http_answer(bytes(range(256)) * 8, "application/octet-stream"), "not JSON"),
    "list": (http_answer(b"[]"), "(array)"),
    "null": (http_answer(b"null"), "null"),
    "text": (http_answer(b'"hello"'), "(string)"),
    "other JSON": (http_answer(b'{"hello": "world"}'), "lacks fields that a farm sends"),
    "deep JSON": (http_answer(b"[" * 100_000), "not JSON"),
    "login": (
        http_answer(b"", "text/html", "302 Found").replace(b"Connection", b"Location: /login\r\nConnection"),
        "/login",
    ),
    "missing": (http_answer(b"<html>404", "text/html", "404 Not Found"), "404"),
}


@contextmanager
def foreign_server(answer: bytes | Callable[[bytes], bytes | Iterator[bytes]]) -> Iterator[int]:
    """Runs the server in the `with` block; yields its port. answer: the response, or a function of the request line."""

    class Handler(socketserver.StreamRequestHandler):
        def handle(self) -> None:
            first = self.rfile.readline()
            length = 0
            while (line := self.rfile.readline().strip()) and b":" in line:
                if line.lower().startswith(b"content-length:"):
                    length = int(line.partition(b":")[2])
            self.rfile.read(length)
            said = answer(first) if callable(answer) else answer
            try:
                for part in [said] if isinstance(said, bytes) else said:
                    self.wfile.write(part)
                    self.wfile.flush()
            except OSError:
                pass  # the client has closed the connection

    server = socketserver.ThreadingTCPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
    thread.start()
    try:
        yield server.server_address[1]
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def json_answer(data: Any) -> bytes:
    """Returns an HTTP response in JSON."""
    return http_answer(json.dumps(data).encode())
