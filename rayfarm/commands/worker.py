"""`rayfarm worker`: this machine's cores for a farm that runs elsewhere."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from rayfarm.blender import Program, Wanted, program_for
from rayfarm.console import err
from rayfarm.joining import farm_address, run, shown_token
from rayfarm.log_format import LogFormat, use_log_format
from rayfarm.machine import cores

__all__ = ["register"]


NIGHT = "When, and for what"


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("worker")(worker)


def worker(
    join: Annotated[str, typer.Option(metavar="URL", help="The farm's address, as http://host:8000.")],
    token: Annotated[
        str, typer.Option(help="The farm's token, where everybody on this machine may see it; better by one of the next.")
    ] = "",
    token_file: Annotated[
        Path | None,
        typer.Option(dir_okay=False, help="A file with the farm's token, or one of this worker's. [dim]$RAYFARM_TOKEN[/dim]"),
    ] = None,
    slots: Annotated[int | None, typer.Option(min=1, help="Batches rendered at a time; one per core unless told.")] = None,
    name: Annotated[str | None, typer.Option(help="What the farm calls this machine; its host name unless told.")] = None,
    tag: Annotated[
        list[str] | None,
        typer.Option(metavar="TAG", help="What jobs may need, as gpu; may be given several times.", rich_help_panel=NIGHT),
    ] = None,
    hours: Annotated[
        str,
        typer.Option(
            metavar="WEEK", help="When it works, as 'Mon-Fri 19:00-07:00, Sat-Sun'; always by itself.", rich_help_panel=NIGHT
        ),
    ] = "",
    idle: Annotated[
        float,
        typer.Option(
            min=0, metavar="MINUTES", help="Work only when nobody has worked at this machine for so long.", rich_help_panel=NIGHT
        ),
    ] = 0.0,
    nice: Annotated[
        int | None, typer.Option(min=0, max=19, help="How far it stands back for other programs.", rich_help_panel=NIGHT)
    ] = None,
    memory: Annotated[
        float, typer.Option(min=0, metavar="GB", help="Memory that it may use; all by itself.", rich_help_panel=NIGHT)
    ] = 0.0,
    site: Annotated[
        str, typer.Option(metavar="NAME", help="Where this machine is: `rayfarm site NAME` adds up what it renders.")
    ] = "",
    blender: Wanted = False,
    blender_program: Program = None,
    log_format: LogFormat = None,
) -> None:
    """Join a farm: render its batches with this machine's cores until Ctrl-C.

    The machine needs a way to the farm's page and to its Redis, and no shared folder. It may come and go at any time.
    It waits for a farm that is away. Where no farm is, or the token is wrong, it ends with 1 and a sentence.

    [bold]Examples[/bold]

      rayfarm worker --join http://studio.local:8000 --token-file ~/farm.token
      RAYFARM_TOKEN=T rayfarm worker --join studio.local:8000 --slots 4 --name attic
      rayfarm worker --join studio.local:8000 --token-file T --hours "Mon-Fri 19:00-07:00, Sat-Sun" --nice 10
      rayfarm worker --join studio.local:8000 --token-file T --idle 15 --tag bigmem
      rayfarm worker --join studio.local:8000 --token-file T --blender
    """
    use_log_format(log_format)
    join = farm_address(join)
    token = shown_token("A worker", token, token_file)
    command = [sys.executable, "-m", "worker", "--service", join, "--slots", str(slots or cores())]
    if name:
        command += ["--name", name]
    said = {"hours": hours, "idle": idle or None, "nice": nice, "memory": memory or None}
    command += [f"--{option}={value}" for option, value in said.items() if value is not None and value != ""]
    command += [f"--tag={each}" for each in tag or ()]
    command += [f"--site={site}"] if site else []
    if (program := program_for(blender, blender_program, lambda text: err.print(text, markup=False, soft_wrap=True))) is not None:
        command.append(f"--blender={program}")
    run("worker", command, token, f"Joining {join} with {slots or cores()} slots. Ctrl-C leaves the farm.")
