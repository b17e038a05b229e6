"""A WebSocket client (RFC 6455) using only the standard library, limited to the features that a farm's live channels need."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import os
import socket
import ssl
import struct
import urllib.parse

from .client import Client, FarmError

__all__ = ["Closed", "Socket"]

TEXT, BINARY, CLOSE, PING, PONG = 1, 2, 8, 9, 10
GUID = b"258EAFA5-E914-47DA-95CA-C5AB0DC85B11"
MOST_BYTES = 1 << 28


class Closed(Exception):  # noqa: N818 -- also when all is well
    """Raised when the connection is closed; its text is the reason, if known."""


class Socket:
    """A WebSocket connection to a path on a farm. Raises FarmError if it cannot be opened."""

    def __init__(self, client: Client, path: str, patience_s: float = 15.0) -> None:
        parts = urllib.parse.urlsplit(client.url)
        host, secure = parts.hostname or "", parts.scheme == "https"
        port = parts.port or (443 if secure else 80)
        try:
            raw = socket.create_connection((host, port), patience_s)
            raw.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._socket = ssl.create_default_context().wrap_socket(raw, server_hostname=host) if secure else raw
        except OSError as error:
            raise FarmError(f"No farm answers at {client.url} ({error.strerror or error}).") from None
        self._buffer = bytearray()
        self._pieces: list[bytes] = []
        self._kind = TEXT
        try:
            self._handshake(parts.netloc.rpartition("@")[2], parts.path.rstrip("/") + path, client)
        except OSError as error:
            self.close()
            raise FarmError(f"No farm answers at {client.url} ({error.strerror or error}).") from None
        except Exception:
            self.close()
            raise

    def _handshake(self, host: str, path: str, client: Client) -> None:
        key = base64.b64encode(os.urandom(16))
        lines = [f"GET {path} HTTP/1.1", f"Host: {host}", "Upgrade: websocket", "Connection: Upgrade"]
        lines += [f"Sec-WebSocket-Key: {key.decode()}", "Sec-WebSocket-Version: 13"]
        lines += [f"{name}: {value}" for name, value in client.headers().items()]
        self._socket.sendall("\r\n".join([*lines, "", ""]).encode())
        while b"\r\n\r\n" not in self._buffer:
            if len(self._buffer) > 1 << 16:
                raise FarmError(f"What answers at {client.url} is no Rayfarm. Is the address right?")
            self._receive_more()
        head, _, rest = bytes(self._buffer).partition(b"\r\n\r\n")
        self._buffer = bytearray(rest)
        status, *headers = head.decode("latin-1").split("\r\n")
        code = status.split(" ")[1] if status.count(" ") else ""
        if code != "101":
            hint = " Check the token in the add-on's preferences." if code in ("401", "403") else ""
            raise FarmError(f"The farm does not open a live channel ({status}).{hint}", int(code) if code.isdigit() else None)
        said = {name.strip().lower(): value.strip() for name, _, value in (line.partition(":") for line in headers)}
        expected = base64.b64encode(hashlib.sha1(key + GUID).digest()).decode()
        if said.get("sec-websocket-accept") != expected:
            raise FarmError(f"What answers at {client.url} is no Rayfarm. Is the address right?")

    def send(self, text: str) -> None:
        """Sends a text message. Raises Closed if the connection is closed."""
        self._send(TEXT, text.encode())

    def _send(self, kind: int, data: bytes) -> None:
        mask = os.urandom(4)
        size = len(data)
        length = bytes([0x80 | size]) if size < 126 else b"\xfe" + struct.pack(">H", size) if size < 1 << 16 else None
        head = bytes([0x80 | kind]) + (length or b"\xff" + struct.pack(">Q", size))
        masked = bytes(byte ^ mask[i % 4] for i, byte in enumerate(data))
        try:
            self._socket.sendall(head + mask + masked)
        except OSError as error:
            raise Closed(str(error)) from None

    def receive(self, wait_s: float) -> str | bytes | None:
        """Returns the next message, or None if none arrives within `wait_s` seconds.

        Raises Closed if the connection is closed.
        """
        while True:
            message = self._next_message()
            if message is not None:
                return message
            self._socket.settimeout(wait_s)
            try:
                self._receive_more()
            except TimeoutError:
                return None
            except OSError as error:
                raise Closed(str(error)) from None

    def _next_message(self) -> str | bytes | None:
        while (frame := self._frame()) is not None:
            is_last, kind, data = frame
            if kind == PING:
                self._send(PONG, data)
            elif kind == CLOSE:
                raise Closed(data[2:].decode(errors="replace"))
            elif kind != PONG:
                self._kind = kind or self._kind  # 0: continuation of the current message
                self._pieces.append(data)
                if is_last:
                    whole, self._pieces = b"".join(self._pieces), []
                    return whole.decode(errors="replace") if self._kind == TEXT else whole
        return None

    def _frame(self) -> tuple[bool, int, bytes] | None:
        if len(self._buffer) < 2:
            return None
        size, at = self._buffer[1] & 127, 2
        if size > 125:
            form = ">H" if size == 126 else ">Q"
            if len(self._buffer) < at + struct.calcsize(form):
                return None
            (size,) = struct.unpack_from(form, self._buffer, at)
            at += struct.calcsize(form)
        if size > MOST_BYTES:
            raise Closed("a message is too long")
        if len(self._buffer) < at + size:
            return None
        found = bool(self._buffer[0] & 128), self._buffer[0] & 15, bytes(self._buffer[at : at + size])
        del self._buffer[: at + size]
        return found

    def _receive_more(self) -> None:
        data = self._socket.recv(1 << 18)
        if not data:
            raise ConnectionResetError("the connection was cut")
        self._buffer += data

    def close(self) -> None:
        """Closes the connection. Never raises an exception."""
        with contextlib.suppress(OSError):
            self._socket.close()
