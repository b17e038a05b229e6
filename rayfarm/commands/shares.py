"""`rayfarm shares`: shows and sets how the farm's slots are shared between users."""

from __future__ import annotations

from typing import Annotated, Any
from urllib.parse import quote

import typer
from rich.table import Table

from rayfarm import options
from rayfarm.console import out
from rayfarm.errors import CommandError
from rayfarm.login import farm_client
from rayfarm.paged import all_of

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command("shares")(shares)


def shares(
    share: Annotated[
        str | None,
        typer.Argument(help="user:NAME, project:NAME, or everybody (jobs without an owner); by default all are listed."),
    ] = None,
    weight: Annotated[float | None, typer.Option(metavar="W", help="Slots are shared in proportion to it; by default 1.")] = None,
    max_slots: Annotated[
        int | None, typer.Option(min=0, metavar="N", help="The most slots for all of its jobs together; 0: no limit.")
    ] = None,
    reset: Annotated[bool, typer.Option("--reset", help="Back to the default: weight 1, no limit.")] = False,
    server: options.Server = None,
) -> None:
    """List the shares of a farm's slots, or change one. Slots are shared between jobs of the same priority.

    [bold]Examples[/bold]

      rayfarm shares
      rayfarm shares user:anna --weight 3
      rayfarm shares project:feature --weight 2
      rayfarm shares user:ben --max-slots 8
      rayfarm shares user:ben --reset
    """
    changes = weight is not None or max_slots is not None
    if share is None and (changes or reset):
        raise CommandError("Say whose share: `rayfarm shares user:NAME --weight 2`")
    if reset and changes:
        raise CommandError("--reset cannot be combined with --weight or --max-slots")
    with farm_client(server) as farm:
        if share is not None and reset:
            farm.call("DELETE", f"/api/shares/{quote(share, safe='')}")
        rows = all_of(farm, "/api/shares")
        if share is not None and changes:
            now: dict[str, Any] = next((row for row in rows if row["share"] == share), {})
            limit = now.get("max_slots") if max_slots is None else max_slots or None
            asked = {"weight": now.get("weight", 1.0) if weight is None else weight, "max_slots": limit}
            farm.call("PUT", f"/api/shares/{quote(share, safe='')}", **asked)
            rows = all_of(farm, "/api/shares")
    table = Table("SHARE", "WEIGHT", "SLOTS AT MOST", "SLOTS NOW", "JOBS", box=None, pad_edge=False)
    for row in rows:
        if share in (None, row["share"]):
            limit = str(row["max_slots"] or "no limit")
            table.add_row(row["share"], f"{row['weight']:g}", limit, str(row["slots"]), str(row["jobs"]))
    if table.row_count:
        out.print(table)
    else:
        out.print("No jobs and no shares yet: all jobs get equal shares. `rayfarm shares user:NAME --weight 2` sets one.")
