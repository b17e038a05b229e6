"""The host names that the service accepts in requests.

A foreign web page can point its own host name at this machine and then read the service's responses as same-origin (DNS
rebinding). This needs a name, so a service that other machines can reach accepts IP addresses, this machine's own names and
configured names, but no others. A service on loopback accepts only loopback's names.
"""

from __future__ import annotations

import ipaddress
import re
import socket
import threading

from service.settings import Settings, is_address

__all__ = ["LOOPBACK_NAMES", "Hosts", "is_local_address", "name_of"]

LOOPBACK_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})
HOST = re.compile(r"(?:\[(?P<address>[0-9A-Fa-f:.]{2,45})\]|(?P<name>[A-Za-z0-9._~-]{1,253}))(?::[0-9]{0,5})?")


def name_of(host: str) -> str | None:
    """Returns the name or address in a Host header, in lower case and without the port; None if malformed (RFC 9110, 7.2)."""
    found = HOST.fullmatch(host)
    if found is None:
        return None
    if found["name"]:
        return found["name"].lower().removesuffix(".")
    return found["address"].lower() if is_address(found["address"]) else None


def is_local_address(address: str) -> bool:
    """Returns True if a client's address is on this machine. A Unix socket has no address and is treated as local."""
    try:
        parsed = ipaddress.ip_address(address)
    except ValueError:
        return True
    return (getattr(parsed, "ipv4_mapped", None) or parsed).is_loopback


class Hosts:
    """The host names accepted by this service."""

    def __init__(self, settings: Settings) -> None:
        self._takes_addresses = not settings.is_loopback
        given = *settings.allowed_hosts, *settings.published_names
        self._names = {*LOOPBACK_NAMES, *(name.lower().removesuffix(".") for name in given)}
        if self._takes_addresses:
            own = socket.gethostname().lower()
            self._names |= {own, f"{own.split('.')[0]}.local", settings.host.lower()}
            # Queries the name server, which may be slow.
            threading.Thread(target=self._ask_for_full_name, name="own name", daemon=True).start()

    def is_accepted(self, name: str) -> bool:
        """Returns True if requests for this host name or address are accepted."""
        return name in self._names or (self._takes_addresses and is_address(name))

    def _ask_for_full_name(self) -> None:
        self._names.add(socket.getfqdn().lower())
