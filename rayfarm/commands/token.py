"""`rayfarm token`: manages access tokens for programs and workers."""

from __future__ import annotations

import time
from typing import Annotated, Literal
from urllib.parse import quote

import typer
from rich.markup import escape
from rich.table import Table

from rayfarm import options
from rayfarm.console import PROGRAM, err, out
from rayfarm.login import farm_client, public_url, server_url
from rayfarm.paged import all_of
from renderer.printable import printable

__all__ = ["register"]

tokens = typer.Typer(name="token", no_args_is_help=True, help="Tokens, with which programs and workers log in to a farm.")


def register(app: typer.Typer) -> None:
    """Adds the commands to the program."""
    app.add_typer(tokens)


@tokens.command("make")
def make(
    name: Annotated[str, typer.Argument(help="Purpose of the token, such as: nightly script")],
    role: Annotated[
        Literal["view", "submit", "admin", "worker"], typer.Option(help="What it permits; worker: to join, and nothing else.")
    ] = "submit",
    days: Annotated[float, typer.Option(min=0, help="How long it lasts; 0: until it is withdrawn.")] = 90,
    server: options.Server = None,
) -> None:
    """Make a token and print it, once. Programs read it from RAYFARM_API_TOKEN, workers from RAYFARM_TOKEN.

    [bold]Examples[/bold]

      rayfarm token make nightly
      rayfarm token make attic --role worker --days 0 > attic.token
    """
    with farm_client(server) as farm:
        made = farm.call("POST", "/api/tokens", name=name, role=role, days=days or None)
    err.print(f"Token {made['id']} for {name!r}; it is shown this once:", markup=False)
    print(printable(made["secret"]))
    if role == "worker":
        where = public_url(server_url(server))
        err.print(f"On that machine: RAYFARM_TOKEN=... {PROGRAM} worker --join {where}", markup=False, soft_wrap=True)


@tokens.command("list")
def show(server: options.Server = None) -> None:
    """List the tokens with their users, roles, expiry dates and last uses."""
    with farm_client(server) as farm:
        rows = all_of(farm, "/api/tokens?all=true")
    table = Table("TOKEN", "FOR", "ROLE", "BY", "UNTIL", "LAST USED", box=None, pad_edge=False)
    for row in rows:
        until = _day(row["expires"]) or "withdrawn"
        table.add_row(row["id"], escape(row["name"]), row["role"], row["user"], until, _day(row["seen"]) or "never")
    out.print(table if rows else "No tokens yet. `rayfarm token make NAME` makes one.")


@tokens.command("withdraw")
def withdraw(
    token: Annotated[str, typer.Argument(help="Its id, as `rayfarm token list` shows it.")], server: options.Server = None
) -> None:
    """Revoke a token at once."""
    with farm_client(server) as farm:
        farm.call("DELETE", f"/api/tokens/{quote(token, safe='')}")
    out.print(f"Token {token} withdrawn.", markup=False)


def _day(moment: float | None) -> str:
    return "" if moment is None else time.strftime("%Y-%m-%d %H:%M", time.localtime(moment))
