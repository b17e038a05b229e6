"""Commands with which workers join this farm, as it was started."""

from __future__ import annotations

import os
import shlex
from dataclasses import dataclass
from pathlib import Path

from service.locations import data_folder_without_variable
from service.settings import Settings

__all__ = ["START_VARIABLE", "URL_VARIABLE", "Joining", "data_variable", "joining"]

# Set by `rayfarm up` for the service that it starts.
START_VARIABLE = "RAYFARM_UP_COMMAND"  # command that starts this farm for other machines; empty if they reach it
URL_VARIABLE = "RAYFARM_UP_URL"  # its URL for other machines; empty if they do not reach it
_COMPOSE = "docker compose"


@dataclass(frozen=True)
class Joining:
    """The commands with which workers join this farm, for a POSIX shell.

    url: for other machines; None if the settings name none that they reach. start: starts the farm for other machines; None if
    they reach it already, or the command is unknown. token: prints a new token for a worker; `here` starts a worker: both run on
    the farm's machine. program: the program on other machines.
    """

    url: str | None
    start: str | None
    token: str
    here: str
    program: str


def data_variable(folder: Path) -> str:
    """Returns the beginning of a shell command that makes it use a data folder; empty for the folder that it uses anyway."""
    return "" if folder == data_folder_without_variable() else f"RAYFARM_DATA={shlex.quote(str(folder))} "


def joining(settings: Settings) -> Joining:
    """Returns how workers join the farm with these settings."""
    if settings.published_names:
        return _joining_containers(settings)
    program = os.environ.get("RAYFARM_PROGRAM", "rayfarm")
    here = f"{data_variable(settings.data)}{program}"
    own = settings.own_url if not settings.is_loopback else f"http://127.0.0.1:{settings.port}"
    url = os.environ.get(URL_VARIABLE) or settings.public_url.rstrip("/") or (None if settings.is_loopback else own)
    return Joining(
        url=url,
        start=os.environ.get(START_VARIABLE) or None,
        token=f"{here} {_token('NAME')} > NAME.token",
        here=f"RAYFARM_TOKEN=$({here} {_token('local')}) {program} worker --join {shlex.quote(url or own)}",
        program=program,
    )


def _token(name: str) -> str:
    return f"token make {name} --role worker --days 0"


def _joining_containers(settings: Settings) -> Joining:
    is_open = settings.needs_login
    port = f"RAYFARM_PORT={settings.published_port} " if settings.published_port not in (0, 8000) else ""
    return Joining(
        url=settings.page_url if is_open else None,
        start=None if is_open else f"{port}RAYFARM_BIND=0.0.0.0 {_COMPOSE} up -d",
        token=f"{_COMPOSE} exec service rayfarm {_token('NAME')} > NAME.token",
        here=f"{_COMPOSE} up -d worker",
        program="python3 farm.py",
    )
