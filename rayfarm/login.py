"""Which farm a command talks to, and the token it sends there."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from rayfarm.client import TOKEN_VARIABLE, Client
from renderer.variables import value_of
from worker.exchange.foreign import is_here

__all__ = ["farm_client", "link_of", "owner_token", "public_url", "server_url"]


def server_url(server: str | None) -> str:
    """The farm to talk to: --server, $RAYFARM_SERVER, the one that runs on the data folder, or this machine's port 8000."""
    from rayfarm.local.state import running_farm
    from service.places import default_data_folder

    if server or (server := os.environ.get("RAYFARM_SERVER")):
        return server
    here = running_farm(default_data_folder())
    return here.url if here else "http://127.0.0.1:8000"


def farm_client(server: str | None) -> Client:
    """The farm that a command talks to.

    It is shown what $RAYFARM_API_TOKEN says; and the farm that runs on this machine's data folder, where nothing is set, its own
    owner's token: who can read that folder owns it.
    """
    from rayfarm.local.state import running_farm
    from service.places import default_data_folder

    url, told = server_url(server), value_of(TOKEN_VARIABLE)
    here = running_farm(default_data_folder())
    if here is None or here.url != url.rstrip("/"):
        return Client(url)
    return Client(url, token=told or owner_token(default_data_folder()), certificate=here.certificate or None)


def owner_token(data: Path) -> str:
    """What lets the owner of a data folder in: what $RAYFARM_OWNER_TOKEN says, else what is kept there; empty where it cannot
    be read."""
    from service.settings import OWNER_TOKEN

    if told := value_of("RAYFARM_OWNER_TOKEN"):
        return told
    with contextlib.suppress(OSError):
        return (data / OWNER_TOKEN).read_text().strip()
    return ""


def public_url(url: str) -> str:
    """How other machines reach the farm at an address, where that is the one that runs here, or in this container."""
    from rayfarm.local.state import running_farm
    from service.places import default_data_folder
    from service.settings import Settings

    here = running_farm(default_data_folder())
    if here is not None and here.url == url and here.public_url:
        return here.public_url
    if any(os.environ.get(name) for name in ("RAYFARM_PUBLIC_URL", "RAYFARM_PUBLISHED")) and is_here(url):
        return Settings.read().page_url
    return url


def link_of(url: str, code: str) -> str:
    """The link. Its code stands behind the #, which no browser sends and no server's log has."""
    return f"{url}/#/login?code={code}"
