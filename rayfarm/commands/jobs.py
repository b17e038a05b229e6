"""`rayfarm jobs`: lists the jobs of a farm."""

from __future__ import annotations

import json
import time
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
    has_shots = any(row.shot for row in rows)
    table = Table(box=None, pad_edge=False)
    table.add_column("JOB", no_wrap=True)
    table.add_column("STATE")
    for title in ("DONE", *(("FRAMES",) if has_shots else ()), "SIZE", "SPP", "AGE"):
        table.add_column(title, justify="right", no_wrap=title == "AGE")
    table.add_column("SCENE")
    now = time.time()
    for row in rows:
        frames = f"{row.shot.states.get('finished', 0)} of {row.shot.count}" if row.shot else ""
        table.add_row(
            *(row.id, row.state, f"{100 * row.progress:.0f} %"),
            *((frames,) if has_shots else ()),
            *(f"{row.width or '?'}x{row.height or '?'}", str(row.spp or ""), _age(now - row.created)),
            escape(row.name or row.scene),
        )
    out.print(table)
    for row in rows:
        if why := row.error or row.warning or row.message:
            out.print(f"{row.id}: {why}", markup=False, soft_wrap=True)


def _age(seconds: float) -> str:
    """Returns a duration in its largest whole unit, such as 5 min."""
    for unit, size in (("d", 86_400), ("h", 3600), ("min", 60)):
        if seconds >= size:
            return f"{seconds // size:.0f} {unit}"
    return f"{max(seconds, 0):.0f} s"
