"""Which farm a command talks to, and the token it sends there."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from rayfarm.client import TOKEN_VARIABLE, Client
from renderer.variables import value_of
from worker.exchange.foreign_server import is_here

__all__ = ["farm_client", "link_of", "owner_token", "public_url", "server_url"]


def server_url(server: str | None) -> str:
    """The address of the farm: --server, $RAYFARM_SERVER, the farm running on the data folder, or this machine's port 8000."""
    from rayfarm.local.state import running_farm
    from service.locations import default_data_folder

    if server or (server := os.environ.get("RAYFARM_SERVER")):
        return server
    here = running_farm(default_data_folder())
    return here.url if here else "http://127.0.0.1:8000"


def farm_client(server: str | None) -> Client:
    """A client of the farm that a command talks to.

    Its token is $RAYFARM_API_TOKEN; if that is unset, the owner's token for a farm that runs on this machine's data folder, since
    read access to that folder implies ownership.
    """
    from rayfarm.local.state import running_farm
    from service.locations import default_data_folder

    url, told = server_url(server), value_of(TOKEN_VARIABLE)
    here = running_farm(default_data_folder())
    if here is None or here.url != url.rstrip("/"):
        return Client(url)
    return Client(url, token=told or owner_token(default_data_folder()), certificate=here.certificate or None)


def owner_token(data: Path) -> str:
    """The token of a data folder's owner: $RAYFARM_OWNER_TOKEN, else the stored one; empty if it cannot be read."""
    from service.settings import OWNER_TOKEN

    if told := value_of("RAYFARM_OWNER_TOKEN"):
        return told
    with contextlib.suppress(OSError):
        return (data / OWNER_TOKEN).read_text().strip()
    return ""


def public_url(url: str) -> str:
    """The address for other machines, if `url` is that of the farm running here or in this container."""
    from rayfarm.local.state import running_farm
    from service.locations import default_data_folder
    from service.settings import Settings

    here = running_farm(default_data_folder())
    if here is not None and here.url == url and here.public_url:
        return here.public_url
    if any(os.environ.get(name) for name in ("RAYFARM_PUBLIC_URL", "RAYFARM_PUBLISHED")) and is_here(url):
        return Settings.read().page_url
    return url


def link_of(url: str, code: str) -> str:
    """A login link. Its code follows the #, which browsers do not send and servers do not log."""
    return f"{url}/#/login?code={code}"
