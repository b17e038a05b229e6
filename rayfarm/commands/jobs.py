"""`rayfarm jobs`: lists the jobs of a farm."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from rayfarm import options
from rayfarm.console import out
from rayfarm.job_lookup import find_job
from rayfarm.login import farm_client

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command("jobs")(jobs)


def jobs(
    job: Annotated[str | None, typer.Argument(help="A job's id, or its beginning; by default all jobs are listed.")] = None,
    server: options.Server = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, for programs.")] = False,
) -> None:
    """List a farm's jobs, or show one job, with the reason if it failed or waits.

    Exits with 1 and a sentence if no farm answers or it has no such job.

    [bold]Examples[/bold]

      rayfarm jobs
      rayfarm jobs --server http://studio:8000
      rayfarm jobs 7f3a --json
    """
    with farm_client(server) as farm:
        rows = farm.jobs() if job is None else [find_job(farm, job)]
    if as_json:
        found = [asdict(row) for row in rows]
        print(json.dumps(found if job is None else found[0], indent=1))
        return
    if not rows:
        out.print("No jobs yet. `rayfarm submit SCENE` makes one.")
        return
    table = Table(box=None, pad_edge=False)
    for title, side in (
        ("JOB", "left"),
        ("STATE", "left"),
        ("DONE", "right"),
        ("FRAMES", "right"),
        ("SIZE", "right"),
        ("SPP", "right"),
        ("SCENE", "left"),
    ):
        table.add_column(title, justify=side, no_wrap=title == "JOB")  # type: ignore[arg-type]
    for row in rows:
        size = f"{row.width or '?'}x{row.height or '?'}"
        done = f"{100 * row.progress:.0f} %"
        frames = f"{row.shot.states.get('finished', 0)} of {row.shot.count}" if row.shot else ""
        table.add_row(row.id, row.state, done, frames, size, str(row.spp or ""), escape(row.name or row.scene))
    out.print(table)
    for row in rows:
        if why := row.error or row.warning or row.message:
            out.print(f"{row.id}: {why}", markup=False, soft_wrap=True)
