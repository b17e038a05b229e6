"""Tests that a worker accepts a farm's own certificate, and that of no other server."""

from __future__ import annotations

import http.server
import ssl
import threading
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from rayfarm.client import Client, ClientError
from tests.worker.exchange.certificates import certificate
from worker.exchange.errors import LinkError, RefusedError
from worker.exchange.link import Link
from worker.exchange.trust import TRUST_VARIABLE, verify_option


@pytest.fixture
def https_server(tmp_path: Path) -> Iterator[tuple[str, Path]]:
    """Yields the URL of an HTTPS server and the path of its certificate, which is for another host name."""
    own, key = certificate(tmp_path, "farm.example")
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), http.server.BaseHTTPRequestHandler)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(own, key)
    server.socket = context.wrap_socket(server.socket, server_side=True)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"https://127.0.0.1:{server.server_port}", own
    server.shutdown()
    thread.join()
    server.server_close()


def test_only_given_certificate_is_accepted(https_server: tuple[str, Path], tmp_path: Path) -> None:
    url, own = https_server
    with httpx.Client(verify=verify_option(str(own))) as client:
        assert client.get(url).status_code == 501  # the server responds
    other, _ = certificate(tmp_path, "other.example")
    both = tmp_path / "both.pem"
    both.write_bytes(other.read_bytes() + own.read_bytes())  # only a file's first certificate counts, not its issuers
    for path in (other, both):
        with (
            httpx.Client(verify=verify_option(str(path))) as client,
            pytest.raises(httpx.ConnectError, match="CERTIFICATE_VERIFY_FAILED"),
        ):
            client.get(url)
    with httpx.Client(verify=verify_option("")) as client, pytest.raises(httpx.ConnectError, match="CERTIFICATE_VERIFY_FAILED"):
        client.get(url)


def test_certificate_is_read_from_environment(https_server: tuple[str, Path], monkeypatch: pytest.MonkeyPatch) -> None:
    url, own = https_server
    with pytest.raises(LinkError, match="certificate verify failed"):
        Link(url, "token").join()
    monkeypatch.setenv(TRUST_VARIABLE, str(own))
    link = Link(url, "token")
    with pytest.raises(LinkError, match="answers 501"):
        link.join()
    link.client.close()
    monkeypatch.setenv(TRUST_VARIABLE, str(own.with_suffix(".key")))
    for refused in (lambda: Link(url, "token").join(), lambda: Client(url)):
        with pytest.raises((RefusedError, ClientError), match="certificate"):
            refused()
