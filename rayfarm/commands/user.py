"""`rayfarm user`: manages the users of a farm that requires a login."""

from __future__ import annotations

import sys
import time
from typing import Annotated, Literal
from urllib.parse import quote

import typer
from rich.table import Table

from rayfarm import options
from rayfarm.console import out
from rayfarm.errors import CommandError
from rayfarm.login import farm_client, link_of, public_url
from rayfarm.paged import all_of
from renderer.printable import printable

__all__ = ["register"]

RoleName = Literal["view", "submit", "admin"]
Name = Annotated[str, typer.Argument(help="The user's name: small letters, digits and . _ @ -")]
users = typer.Typer(name="user", no_args_is_help=True, help="Who may use a farm that requires a login.")


def register(app: typer.Typer) -> None:
    """Adds the commands to the program."""
    app.add_typer(users)


@users.command("add")
def add(
    name: Name,
    role: Annotated[RoleName, typer.Option(help="view: look; submit: render too; admin: workers and users too.")] = "submit",
    password: Annotated[
        bool, typer.Option("--password", help="Read a password from the terminal or from a line of standard input.")
    ] = False,
    server: options.Server = None,
) -> None:
    """Add a user. Prints a link that works once, with which they log in and choose a password.

    [bold]Examples[/bold]

      rayfarm user add anna
      rayfarm user add ben --role view --password
    """
    with farm_client(server) as farm:
        chosen = {"password": _password()} if password else {}
        farm.call("POST", "/api/users", name=name, role=role, **chosen)
        if password:
            out.print(f"{name} may log in as {role}.", markup=False)
        else:
            code = farm.call("POST", "/api/links", user=name)["code"]
            out.print(f"{name} may log in as {role}, by this link, once, within a day:", markup=False)
            print(printable(link_of(public_url(farm.url), code)))


@users.command("list")
def show(server: options.Server = None) -> None:
    """List the users, their roles, and how many browsers each is logged in with."""
    with farm_client(server) as farm:
        rows = all_of(farm, "/api/users")
    if not rows:
        out.print("No users yet. `rayfarm user add NAME` lets one in; you are let in as the farm's owner.")
        return
    table = Table("USER", "ROLE", "PASSWORD", "LOGGED IN", "SINCE", box=None, pad_edge=False)
    for row in rows:
        since = time.strftime("%Y-%m-%d", time.localtime(row["created"]))
        table.add_row(row["name"], row["role"], "yes" if row["has_password"] else "by link", str(row["sessions"]), since)
    out.print(table)


@users.command("role")
def role(name: Name, role: RoleName, server: options.Server = None) -> None:
    """Change a user's role. It takes effect at once."""
    with farm_client(server) as farm:
        farm.call("PATCH", f"/api/users/{quote(name, safe='')}", role=role)
    out.print(f"{name} now has the role {role}.", markup=False)


@users.command("password")
def password(name: Name, server: options.Server = None) -> None:
    """Change a user's password, which is read from the terminal. All of the user's sessions end."""
    with farm_client(server) as farm:
        farm.call("PATCH", f"/api/users/{quote(name, safe='')}", password=_password())
    out.print(f"Password of {name} changed; all sessions ended.", markup=False)


@users.command("remove")
def remove(name: Name, server: options.Server = None) -> None:
    """Delete a user. The user's scenes and jobs stay."""
    with farm_client(server) as farm:
        farm.call("DELETE", f"/api/users/{quote(name, safe='')}")
    out.print(f"User {name} removed.", markup=False)


@users.command("link")
def link(
    name: Annotated[str, typer.Argument(help="The user to log in; by default the owner of the farm.")] = "owner",
    server: options.Server = None,
) -> None:
    """Print a login link that can be used once, within a day."""
    with farm_client(server) as farm:
        print(printable(link_of(public_url(farm.url), farm.call("POST", "/api/links", user=name)["code"])))


def _password() -> str:
    """Reads a password: typed twice, hidden, on a terminal; otherwise one line of standard input."""
    if not sys.stdin.isatty():
        return sys.stdin.readline().rstrip("\n")
    chosen: str = typer.prompt("Password", hide_input=True, confirmation_prompt=True)
    if not chosen:
        raise CommandError("No password was given.")
    return chosen
