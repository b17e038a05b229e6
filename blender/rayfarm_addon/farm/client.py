"""HTTP client for a farm, using only the standard library. All methods block; call them from a worker thread."""

from __future__ import annotations

import http.client
import json
import ssl
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator
from typing import Any

from .multipart import Part, body_of

__all__ = ["Cancelled", "Client", "FarmError"]

PATIENCE_S = 15.0  # timeout
LOOPBACK = ("localhost", "127.0.0.1", "::1")


class FarmError(Exception):
    """Raised if a request to the farm failed; its text is a sentence for the user.

    status: the HTTP status, or None if there was no response.
    """

    def __init__(self, sentence: str, status: int | None = None) -> None:
        super().__init__(sentence)
        self.status = status


class Cancelled(Exception):  # noqa: N818 -- nothing went wrong
    """Raised when the caller has cancelled the operation."""


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    """A urllib handler that refuses redirects, so that the token is sent only to the configured farm."""

    def redirect_request(self, *_: Any) -> None:
        return None


class Client:
    """A client for one farm. url: the farm's address, as in the browser; token: as printed by `rayfarm token make`, or empty."""

    def __init__(self, url: str, token: str = "") -> None:
        self.url = url.strip().rstrip("/")
        self.token = token.strip()
        parts = urllib.parse.urlsplit(self.url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise FarmError(f"{self.url or 'An empty line'} is no address of a farm. Give one as http://127.0.0.1:8000.")
        handlers: list[Any] = [_NoRedirect()]
        if parts.hostname in LOOPBACK:
            handlers.append(urllib.request.ProxyHandler({}))
        self._opener = urllib.request.build_opener(*handlers)
        self.sent = 0  # bytes of all uploads so far

    def headers(self) -> dict[str, str]:
        """The authentication headers to send with each request."""
        return {"Authorization": f"Bearer {self.token}"} if self.token else {}

    def request(
        self,
        method: str,
        path: str,
        data: Any = None,
        headers: dict[str, str] | None = None,
        patience_s: float = PATIENCE_S,
    ) -> tuple[int, Any, bytes]:
        """Sends a request; returns (status, headers, body). data: bytes, or an iterator of bytes. patience_s: the timeout in
        seconds.

        Raises FarmError if there is no response or for error statuses; 304 is returned.
        """
        request = urllib.request.Request(self.url + path, data=data, method=method, headers={**self.headers(), **(headers or {})})
        try:
            with self._opener.open(request, timeout=patience_s) as answer:
                return answer.status, answer.headers, answer.read()
        except urllib.error.HTTPError as error:
            if error.code == 304:
                return 304, error.headers, b""
            raise FarmError(_error_sentence(error), error.code) from None
        except Cancelled:
            raise
        except (urllib.error.URLError, http.client.HTTPException, OSError, ValueError) as error:
            raise FarmError(
                f"No farm answers at {self.url} ({_connection_error_text(error)}). Is it running, and is the address right?"
            ) from None

    def json(self, method: str, path: str, payload: Any = None, **headers: str) -> Any:
        """Sends a request with JSON content `payload` (None: no content) and returns the decoded response; None if that is empty.

        headers: further headers, with _ instead of -. Raises FarmError if the request fails.
        """
        data = None if payload is None else json.dumps(payload).encode()
        known = {"Content-Type": "application/json"} if data is not None else {}
        _, _, body = self.request(
            method, path, data, {**known, **{name.replace("_", "-"): value for name, value in headers.items()}}
        )
        if not body:
            return None
        try:
            return json.loads(body)
        except ValueError:
            raise FarmError(f"What answers at {self.url} is no Rayfarm. Is the address right?") from None

    def send_files(
        self,
        path: str,
        parts: list[Part],
        fields: dict[str, str],
        progress: Callable[[int, int], None] = lambda done, size: None,
    ) -> Any:
        """Posts files as a multipart form and returns the decoded JSON response.

        progress: called with bytes sent and total bytes; it may raise Cancelled. Raises FarmError if the request fails.
        """
        kind, size, chunks = body_of(parts, fields)

        def chunks_with_progress() -> Iterator[bytes]:
            done = 0
            for chunk in chunks:
                progress(done, size)
                yield chunk
                done += len(chunk)
                self.sent += len(chunk)
            progress(done, size)

        headers = {"Content-Type": kind, "Content-Length": str(size)}
        _, _, body = self.request("POST", path, chunks_with_progress(), headers, patience_s=120.0)
        return json.loads(body)

    def check(self) -> str:
        """Tests the connection; returns a sentence for the user about the farm's workers. Raises FarmError if the test fails."""
        info = self.json("GET", "/api/info")
        if not isinstance(info, dict) or "formats" not in info:
            raise FarmError(f"What answers at {self.url} is no Rayfarm. Is the address right?")
        workers = self.json("GET", "/api/workers")
        slots = sum(int(each.get("slots") or 0) for each in workers)
        who = self.json("GET", "/api/session") or {}
        name = f" as {who['name']}" if who.get("name") else ""
        if not slots:
            return f"Connected{name}. No worker is there yet: pictures wait for one."
        return f"Connected{name}: {len(workers)} worker{'s' * (len(workers) != 1)}, {slots} slot{'s' * (slots != 1)}."


def _error_sentence(error: urllib.error.HTTPError) -> str:
    try:
        detail = json.loads(error.read(1 << 16)).get("detail")
    except (ValueError, AttributeError, OSError):
        detail = None
    if error.code in (401, 403):
        hint = "Check the token in the add-on's preferences; `rayfarm token make` makes one."
        return f"The farm does not let this through: {detail or error.reason} {hint}"
    return str(detail or f"The farm answered {error.code} ({error.reason}).")


def _connection_error_text(error: Exception) -> str:
    reason = getattr(error, "reason", None) or error
    if isinstance(reason, TimeoutError):
        return "it does not answer in time"
    if isinstance(reason, ssl.SSLError):
        return f"its certificate is not trusted: {reason.reason}"
    return str(getattr(reason, "strerror", None) or reason)
