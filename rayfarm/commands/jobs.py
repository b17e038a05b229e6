"""`rayfarm jobs`: what a farm works on."""

from __future__ import annotations

import json
from typing import Annotated, Any

import typer
from rich.table import Table

from rayfarm import options
from rayfarm.client import Client
from rayfarm.commands.submit import server_url
from rayfarm.console import out

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("jobs")(jobs)


def jobs(
    job: Annotated[str | None, typer.Argument(help="One job's number; all jobs unless told.")] = None,
    server: options.Server = None,
    as_json: Annotated[bool, typer.Option("--json", help="For programs.")] = False,
) -> None:
    """List a farm's jobs, or show one of them.

    [bold]Examples[/bold]

      rayfarm jobs
      rayfarm jobs 7f3a --json
    """
    with Client(server_url(server)) as farm:
        found: list[dict[str, Any]] | dict[str, Any] = farm.jobs() if job is None else farm.job(job)
    if as_json:
        print(json.dumps(found, indent=1))
        return
    rows = found if isinstance(found, list) else [found]
    if not rows:
        out.print("No jobs yet. `rayfarm submit SCENE` makes one.")
        return
    table = Table(box=None, pad_edge=False)
    for title, side in (
        ("JOB", "left"),
        ("STATE", "left"),
        ("DONE", "right"),
        ("SIZE", "right"),
        ("SPP", "right"),
        ("SCENE", "left"),
    ):
        table.add_column(title, justify=side)  # type: ignore[arg-type]
    for row in rows:
        size = f"{row.get('width', '?')}x{row.get('height', '?')}"
        name = str(row.get("name") or row.get("scene_name") or row.get("scene", ""))
        table.add_row(row["id"], row["state"], f"{100 * row['progress']:.0f} %", size, str(row.get("spp") or ""), name)
    out.print(table)
    for row in rows:
        if row.get("error"):
            out.print(f"{row['id']}: {row['error']}", markup=False, soft_wrap=True)
