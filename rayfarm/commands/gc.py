"""`rayfarm gc`: lists or deletes data that a farm need not keep."""

from __future__ import annotations

import json
import sys
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from rayfarm import options
from rayfarm.console import err, out
from rayfarm.errors import CommandError
from rayfarm.login import farm_client

__all__ = ["register"]

MAX_SHOWN_ITEMS = 40
KIND_NAMES = {"film": "film", "compiled": "compiled scene", "upload": "upload"}


def register(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command("gc")(gc)


def gc(
    films_older_than: Annotated[
        float | None, typer.Option(min=0, metavar="DAYS", help="Delete films of jobs that ended longer ago.")
    ] = None,
    films_above: Annotated[
        float | None, typer.Option(min=0, metavar="GB", help="Delete the oldest films until all take no more than this.")
    ] = None,
    compiled_older_than: Annotated[
        float | None, typer.Option(min=0, metavar="DAYS", help="Delete compiled scenes unused for this long.")
    ] = None,
    uploads_older_than: Annotated[
        float | None,
        typer.Option(min=0, metavar="DAYS", help="Delete uploaded scenes unused for this long; they cannot be restored."),
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="List what would be deleted, and delete nothing.")] = False,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Do not ask first.")] = False,
    server: options.Server = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, for programs.")] = False,
) -> None:
    """Delete data that can be restored or is unused: old films, unused compiled scenes and uploads.

    Without options it follows the farm's own rules, RAYFARM_KEEP_FILMS_DAYS and the like, which the farm applies every hour by
    itself; by default they keep everything. A deleted film is rendered again, to the same bits, when its job is set to running;
    a scene is compiled again when it is next used. Data of unfinished and pinned jobs is kept.

    [bold]Examples[/bold]

      rayfarm gc --films-older-than 30 --dry-run
      rayfarm gc --films-above 500 --compiled-older-than 7 --yes
    """
    rules: dict[str, Any] = {
        "films_days": films_older_than,
        "films_bytes": None if films_above is None else round(films_above * 1e9),
        "compiled_days": compiled_older_than,
        "uploads_days": uploads_older_than,
    }
    with farm_client(server) as farm:
        found = farm.let_go(dry_run=True, **rules)
        if not dry_run and found["items"]:
            if not as_json:
                _print_items(found)
            if not yes and not (sys.stdin.isatty() and typer.confirm("Let these go?")):
                raise CommandError("Nothing was deleted. --yes deletes without asking.")
            with err.status("Looking for what may go ...") as status:

                def show_progress(done: int, planned: int | None) -> None:
                    if planned is not None:
                        status.update(f"{done} of {planned} are done ...")

                found = farm.let_go(dry_run=False, progress=show_progress, **rules)
    if as_json:
        print(json.dumps(found, indent=1))
    elif dry_run or not found["items"]:
        _print_items(found)
    else:
        out.print(f"{len(found['items'])} deleted, {_gigabytes(found['bytes'])} freed.")


def _print_items(found: dict[str, Any]) -> None:
    items = found["items"]
    if not items:
        out.print("These rules delete nothing.")
        return
    table = Table(box=None, pad_edge=False)
    for title in ("WHAT", "ID", "SIZE", "DAYS", "WHY", "NAME"):
        table.add_column(title, justify="right" if title in ("SIZE", "DAYS") else "left")
    for item in items[:MAX_SHOWN_ITEMS]:
        days = f"{item['age_s'] / 86400:.0f}"
        table.add_row(KIND_NAMES[item["what"]], item["id"], _gigabytes(item["bytes"]), days, item["why"], escape(item["name"]))
    out.print(table)
    more = f" {len(items) - MAX_SHOWN_ITEMS} more are not shown." if len(items) > MAX_SHOWN_ITEMS else ""
    out.print(f"{len(items)} would be deleted, {_gigabytes(found['bytes'])}.{more}")


def _gigabytes(size: int) -> str:
    return f"{size / 1e9:.2f} GB" if size >= 1e8 else f"{size / 1e6:.1f} MB"
