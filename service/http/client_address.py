"""Client addresses behind proxies: which header fields are trusted, from which proxies.

X-Forwarded-For and X-Forwarded-Proto are used only if the connection comes from an address in RAYFARM_TRUSTED_PROXIES. The client
is then the rightmost address that is not itself a trusted proxy. A standby of the same farm signs the origin of requests that it
forwards. From all other addresses these fields are ignored: the client is the peer of the connection.
"""

from __future__ import annotations

import hashlib
import hmac
import ipaddress
import logging
from collections.abc import Iterable
from typing import Any

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.middleware.proxy_headers import ProxyHeadersMiddleware

from service.settings import Settings

__all__ = ["PASSED_ON", "ClientAddress", "is_from_proxy", "signed_origin"]

log = logging.getLogger(__name__)

PASSED_ON = "x-rayfarm-passed-on"  # on requests from a standby, which are not forwarded again
PEER = "rayfarm.peer"  # key in the scope of the connection's peer
NO_ADDRESS = "-"
SCHEMES = ("http", "https", "ws", "wss")
FORWARDED = frozenset(
    (
        *(
            "forwarded",
            "forwarded-for",
            "via",
            "cdn-loop",
            "true-client-ip",
            "client-ip",
            "proxy-client-ip",
            "wl-proxy-client-ip",
        ),
        *("x-forwarded", "x-real-ip", "x-client-ip", "x-cluster-client-ip", "x-proxyuser-ip", "x-remote-ip", "x-remote-addr"),
        *("x-scheme", "x-arr-ssl", "x-arr-log-id", "x-url-scheme", "front-end-https", "x-azure-clientip", "x-amzn-trace-id"),
    )
)
FORWARDED_PREFIXES = ("x-forwarded-", "x-original-", "x-envoy-", "cf-", "fastly-", "tailscale-", "ngrok-", "x-appengine-")
UNTRUSTED = (
    "A proxy at %s sends X-Forwarded-For, but is not one of RAYFARM_TRUSTED_PROXIES: the header is ignored, and all its clients "
    "count as one address. If the proxy is yours, set RAYFARM_TRUSTED_PROXIES=%s."
)


class ClientAddress:
    """The outermost ASGI middleware: sets `client` and `scheme` in the scope from trusted header fields."""

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        self._app = app
        self._settings = settings
        self._believing: Any = ProxyHeadersMiddleware(self._checked, settings.trusted_proxies.split())  # type: ignore[arg-type]
        self._has_warned = False

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Sets the client's address and scheme in the scope, then calls the application."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        word = Headers(scope=scope).get(PASSED_ON, "")
        if (origin := _verified_origin(word, self._settings.owner_token)) is not None:
            address, scheme = origin
            if address:
                scope["client"] = (address, 0)
            scope["scheme"] = scheme
            await self._app(scope, receive, send)
            return
        scope[PEER] = scope.get("client")
        await self._believing(scope, receive, send)

    async def _checked(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Calls the application with the forwarded address of the client, or with the peer's own address if that is malformed."""
        peer = scope.pop(PEER)
        if scope.get("client") != peer:
            try:
                address = ipaddress.ip_address(scope["client"][0])
            except ValueError:
                scope["client"] = peer
            else:
                scope["client"] = (str(getattr(address, "ipv4_mapped", None) or address), scope["client"][1])
        elif not self._has_warned and peer is not None and any(name == b"x-forwarded-for" for name, _ in scope["headers"]):
            self._has_warned = True  # once, since any client can send the header
            log.warning(UNTRUSTED, peer[0], peer[0])
        await self._app(scope, receive, send)


def is_from_proxy(scope: Scope) -> bool:
    """Returns True if a request came through a proxy: it has header fields that proxies add, or uses HTTP/1.0.

    By default nginx uses HTTP/1.0 towards its upstream, with the upstream's own address as Host, and adds no field.
    """
    return scope.get("http_version") == "1.0" or _names_proxy(name for name, _ in scope["headers"])


def _names_proxy(names: Iterable[bytes]) -> bool:
    lower = (name.decode("latin-1").lower() for name in names)
    return any(name in FORWARDED or name.startswith(FORWARDED_PREFIXES) for name in lower)


def signed_origin(scope: Scope, address: str, secret: str) -> str:
    """Returns the signed value of the header PASSED_ON, by which a standby passes the client's address to the farm's owner.

    address: the client's; "" for a local client. The value includes the scheme (http or https).
    """
    said = f"{address or NO_ADDRESS} {scope['scheme']}"
    return f"{said} {_signature(said, secret)}"


def _verified_origin(word: str, secret: str) -> tuple[str, str] | None:
    """Verifies a value made by `signed_origin`, and returns its address and scheme.

    None if the value is missing or its signature is invalid.
    """
    said, _, signature = word.rpartition(" ")
    if not secret or not said or not hmac.compare_digest(signature.encode(), _signature(said, secret).encode()):
        return None
    address, _, scheme = said.partition(" ")
    return (address.removeprefix(NO_ADDRESS), scheme) if scheme in SCHEMES else None


def _signature(header: str, secret: str) -> str:
    return hmac.new(secret.encode(), f"forwarded: {header}".encode(), hashlib.sha256).hexdigest()
