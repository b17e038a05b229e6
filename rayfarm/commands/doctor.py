"""`rayfarm doctor`: checks this installation."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.text import Text

from rayfarm.console import bar, out
from rayfarm.errors import EXIT_FAILED, CommandError

if TYPE_CHECKING:
    from rayfarm.doctor.finding import Finding

__all__ = ["register"]

MARKS = {"fine": ("ok   ", "green"), "fact": ("-    ", "dim"), "note": ("note ", "yellow"), "fault": ("FAULT", "bold red")}


def register(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command("doctor")(doctor)


def doctor(
    data: Annotated[
        Path | None, typer.Option(file_okay=False, help="The farm's data folder; `up` names it. [dim]$RAYFARM_DATA[/dim]")
    ] = None,
    deep: Annotated[
        bool, typer.Option("--deep", help="Read every upload and film, and check them against their hashes.")
    ] = False,
    port: Annotated[int, typer.Option(min=1, max=65535, help="The port a farm would use.")] = 8000,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, for programs.")] = False,
) -> None:
    """Check this installation: say in sentences what is wrong and what to do about it. Changes nothing.

    It checks Python, the compiler and the processor, the denoiser, memory, cache and clock; the data folder's permissions,
    free space, database, uploads and films; the farm that runs on it, its Redis and its workers. The exit code is 0 if
    there is no fault, otherwise 1; a note is not a fault.

    [bold]Examples[/bold]

      rayfarm doctor
      rayfarm doctor --deep --data ~/farm       every film and file, too
      rayfarm doctor --json | jq '.[] | select(.level == "fault")'
    """
    found = []
    for finding in _findings(data, deep, port):
        found.append(finding)
        if not as_json:
            _print_finding(finding)
    faults = sum(finding.level == "fault" for finding in found)
    notes = sum(finding.level == "note" for finding in found)
    if as_json:
        print(json.dumps([asdict(finding) for finding in found], indent=1))
    else:
        out.print(f"\n{faults or 'No'} fault{'' if faults == 1 else 's'}, {notes or 'no'} note{'' if notes == 1 else 's'}.")
    if faults:
        raise typer.Exit(EXIT_FAILED)


def _findings(data: Path | None, deep: bool, port: int) -> Iterator[Finding]:
    from rayfarm.doctor.folder import check_folder
    from rayfarm.doctor.machine import check_machine
    from rayfarm.doctor.running import check_running_farm
    from service.errors import FarmError
    from service.locations import default_data_folder
    from service.settings import Settings

    try:
        settings = Settings.read(data=data.expanduser().resolve() if data else default_data_folder())
    except FarmError as error:
        raise CommandError(str(error)) from None
    yield from check_machine()
    with bar() as shown:
        task = shown.add_task("Reading uploads and films", total=None, visible=deep)
        yield from check_folder(settings, deep, lambda done, total: shown.update(task, completed=done, total=total))
    yield from check_running_farm(settings, port)


def _print_finding(finding: Finding) -> None:
    mark, style = MARKS[finding.level]
    line = Text.assemble((mark, style), "  ", (f"{finding.about:<12}", "bold"), " ", finding.says)
    out.print(line, soft_wrap=True)
    if finding.do:
        out.print(Text(f"{'':20}-> {finding.do}", style="cyan" if finding.level == "note" else "bold"), soft_wrap=True)
