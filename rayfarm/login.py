"""Selects the farm that a command uses, and the token that it sends."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from rayfarm.client import TOKEN_VARIABLE, Client
from renderer.variables import value_of
from worker.exchange.foreign_server import is_loopback

__all__ = ["farm_client", "link_of", "owner_token", "public_url", "server_url"]


def server_url(server: str | None) -> str:
    """Returns the farm's URL: --server, $RAYFARM_SERVER, the farm running on the data folder, or port 8000 on this machine."""
    from rayfarm.local.state import running_farm
    from service.locations import default_data_folder

    if server or (server := os.environ.get("RAYFARM_SERVER")):
        return server
    here = running_farm(default_data_folder())
    return here.url if here else "http://127.0.0.1:8000"


def farm_client(server: str | None) -> Client:
    """Returns a client of the farm that a command uses.

    Its token is $RAYFARM_API_TOKEN. If that is unset and the farm runs on this machine's data folder, it is the owner's token,
    since anyone who can read that folder owns the farm.
    """
    from rayfarm.local.state import running_farm
    from service.locations import default_data_folder

    url, told = server_url(server), value_of(TOKEN_VARIABLE)
    here = running_farm(default_data_folder())
    if here is None or here.url != url.rstrip("/"):
        return Client(url)
    return Client(url, token=told or owner_token(default_data_folder()), certificate=here.certificate or None)


def owner_token(data: Path) -> str:
    """Returns the owner's token of a data folder: $RAYFARM_OWNER_TOKEN, or the stored one; empty if it cannot be read."""
    from service.settings import OWNER_TOKEN

    if told := value_of("RAYFARM_OWNER_TOKEN"):
        return told
    with contextlib.suppress(OSError):
        return (data / OWNER_TOKEN).read_text().strip()
    return ""


def public_url(url: str) -> str:
    """Returns the URL for other machines if `url` is a farm that runs here or in this container; otherwise `url`."""
    from rayfarm.local.state import running_farm
    from service.locations import default_data_folder
    from service.settings import Settings

    here = running_farm(default_data_folder())
    if here is not None and here.url == url and here.public_url:
        return here.public_url
    if any(os.environ.get(name) for name in ("RAYFARM_PUBLIC_URL", "RAYFARM_PUBLISHED")) and is_loopback(url):
        return Settings.read().page_url
    return url


def link_of(url: str, code: str) -> str:
    """Returns a login link. Its code follows the #, a part that browsers do not send and servers do not log."""
    return f"{url}/#/login?code={code}"
