"""`rayfarm project`: manages projects, whose scenes and jobs are visible only to their members."""

from __future__ import annotations

from typing import Annotated
from urllib.parse import quote

import typer
from rich.table import Table

from rayfarm import options
from rayfarm.console import out
from rayfarm.login import farm_client
from rayfarm.paged import all_of

__all__ = ["register"]

Name = Annotated[str, typer.Argument(help="The project's name: small letters, digits and . _ @ -")]
User = Annotated[str, typer.Argument(help="A user of the farm, as `rayfarm user list` shows them.")]
projects = typer.Typer(name="project", no_args_is_help=True, help="Scenes and jobs that only their members see.")


def register(app: typer.Typer) -> None:
    """Adds the commands to the program."""
    app.add_typer(projects)


@projects.command("add")
def add(
    name: Name,
    members: Annotated[list[str] | None, typer.Argument(help="The project's first members.")] = None,
    server: options.Server = None,
) -> None:
    """Make a project. Its scenes and the jobs that render them are visible only to its members and administrators.

    [bold]Examples[/bold]

      rayfarm project add feature anna ben
      rayfarm submit shot.glb --project feature
    """
    with farm_client(server) as farm:
        farm.call("POST", "/api/projects", name=name)
        for user in members or ():
            farm.call("PUT", f"/api/projects/{quote(name, safe='')}/members/{quote(user, safe='')}")
    out.print(f"Project {name} added, {'for ' + ', '.join(members) if members else 'without members'}.", markup=False)


@projects.command("list")
def show(server: options.Server = None) -> None:
    """List the projects visible to you, with their members and contents."""
    with farm_client(server) as farm:
        rows = all_of(farm, "/api/projects")
    table = Table("PROJECT", "MEMBERS", "SCENES", "JOBS", box=None, pad_edge=False)
    for row in rows:
        counts = (str(row["counts"].get(kind, 0)) for kind in ("scene", "job"))
        roles = row.get("roles", {})  # missing in answers of older releases
        members = (f"{name} (looks)" if roles.get(name) == "view" else name for name in row["members"])
        table.add_row(row["name"], ", ".join(members) or "none", *counts)
    out.print(table if rows else "No projects. `rayfarm project add NAME` makes one.")


@projects.command("let-in")
def add_member(
    name: Name,
    user: User,
    only_look: Annotated[bool, typer.Option("--only-look", help="Read-only access to the project.")] = False,
    server: options.Server = None,
) -> None:
    """Add a user to a project, or change a member's access."""
    asked = {"role": "view"} if only_look else {}
    with farm_client(server) as farm:
        farm.call("PUT", f"/api/projects/{quote(name, safe='')}/members/{quote(user, safe='')}", **asked)
    out.print(f"{user} {'may look at' if only_look else 'has access to'} {name}.", markup=False)


@projects.command("put-out")
def remove_member(name: Name, user: User, server: options.Server = None) -> None:
    """Remove a user from a project. Open pages lose access at once."""
    with farm_client(server) as farm:
        farm.call("DELETE", f"/api/projects/{quote(name, safe='')}/members/{quote(user, safe='')}")
    out.print(f"{user} no longer has access to {name}.", markup=False)


@projects.command("remove")
def remove(name: Name, server: options.Server = None) -> None:
    """Remove a project that is empty."""
    with farm_client(server) as farm:
        farm.call("DELETE", f"/api/projects/{quote(name, safe='')}")
    out.print(f"Project {name} removed.", markup=False)
