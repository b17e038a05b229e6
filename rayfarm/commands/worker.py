"""`rayfarm worker`: renders for a farm with the cores and the graphics cards of this machine."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from rayfarm.blender import Program, Wanted, program_for
from rayfarm.console import err
from rayfarm.errors import CommandError
from rayfarm.graphics_card import WorkerCards, slot_count
from rayfarm.joining import farm_address, run, token_to_send
from rayfarm.local import early
from rayfarm.log_format import LogFormat, use_log_format
from rayfarm.machine import cores

__all__ = ["register"]


class Transport(StrEnum):
    """How a worker reaches the farm's queue: worker.joining.TRANSPORTS."""

    AUTO = "auto"
    REDIS = "redis"
    HTTPS = "https"


NIGHT = "When, and for what"


def register(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command("worker")(worker)


def worker(
    farm: Annotated[
        str | None, typer.Argument(metavar="URL", help="The farm's address, such as https://farm.example.", show_default=False)
    ] = None,
    join: Annotated[str | None, typer.Option(metavar="URL", help="The farm's address, if not given as the argument.")] = None,
    token: Annotated[
        str,
        typer.Option(help="The farm's token; everyone on this machine can see it, so --token-file or $RAYFARM_TOKEN is better."),
    ] = "",
    token_file: Annotated[
        Path | None,
        typer.Option(dir_okay=False, help="A file with the farm's token, or with this worker's own. [dim]$RAYFARM_TOKEN[/dim]"),
    ] = None,
    transport: Annotated[
        Transport,
        typer.Option(
            help="How to reach the farm's queue: redis; https: through the farm's address alone; auto: Redis if this machine "
            "reaches it."
        ),
    ] = Transport.AUTO,
    slots: Annotated[int | None, typer.Option(min=1, help="Batches rendered at a time; by default one per core.")] = None,
    gpu: WorkerCards = "auto",
    name: Annotated[str | None, typer.Option(help="The worker's name; by default this machine's host name.")] = None,
    tag: Annotated[
        list[str] | None,
        typer.Option(
            metavar="TAG", help="A tag that jobs may need, such as gpu; may be given several times.", rich_help_panel=NIGHT
        ),
    ] = None,
    hours: Annotated[
        str,
        typer.Option(
            metavar="WEEK",
            help="When it works, such as 'Mon-Fri 19:00-07:00, Sat-Sun'; by default always.",
            rich_help_panel=NIGHT,
        ),
    ] = "",
    idle: Annotated[
        float,
        typer.Option(
            min=0,
            metavar="MINUTES",
            help="Accept work only after this machine has been unused for this long.",
            show_default=False,
            rich_help_panel=NIGHT,
        ),
    ] = 0.0,
    nice: Annotated[
        int | None,
        typer.Option(
            min=0, max=19, help="Its nice level: higher leaves more of the machine to other programs.", rich_help_panel=NIGHT
        ),
    ] = None,
    memory: Annotated[
        float,
        typer.Option(
            min=0, metavar="GB", help="Memory that it may use; by default all.", show_default=False, rich_help_panel=NIGHT
        ),
    ] = 0.0,
    site: Annotated[
        str,
        typer.Option(metavar="NAME", help="The site of this machine, whose reducer (`rayfarm site NAME`) adds up its results."),
    ] = "",
    blender: Wanted = False,
    blender_program: Program = None,
    log_format: LogFormat = None,
) -> None:
    """Join a farm: render its batches with this machine's cores and NVIDIA cards until Ctrl-C.

    The machine needs network access to the farm's page, but no shared folder. Where it does not reach the farm's Redis, all
    goes over HTTPS through the farm's address. It may join and leave at any time, and waits while the farm is down. If there is
    no farm, or the token is wrong, it exits with 1 and a sentence.

    [bold]Examples[/bold]

      rayfarm worker --join http://studio.local:8000 --token-file ~/farm.token
      RAYFARM_TOKEN=T rayfarm worker --join studio:8000 --slots 4 --name attic
      rayfarm worker --join studio:8000 --token-file T --hours "19:00-07:00"
      rayfarm worker --join studio:8000 --token-file T --idle 15 --tag bigmem
      rayfarm worker --join studio:8000 --token-file T --blender
      rayfarm worker --join studio:8000 --token-file T --gpu 0,1
      rayfarm worker https://farm.example --token-file T       from home
    """
    use_log_format(log_format)
    if (farm is None) == (join is None):
        raise CommandError("Give the farm's address once: `rayfarm worker https://farm.example`, or with --join.")
    join = farm_address(farm or join or "")
    token = token_to_send("A worker", token, token_file)
    count = slot_count(gpu, slots or cores())
    arguments = ["--service", join, "--slots", str(slots or cores())]
    said = {"transport": transport.value, "hours": hours, "idle": idle or None, "nice": nice, "memory": memory or None}
    arguments += [f"--{option}={value}" for option, value in said.items() if value is not None and value != ""]
    arguments += [f"--tag={each}" for each in tag or ()]
    arguments += [f"--site={site}"] if site else []
    arguments.append(f"--gpu={gpu}")
    arguments += ["--name", name] if name else []
    if (program := program_for(blender, blender_program, lambda text: err.print(text, markup=False, soft_wrap=True))) is not None:
        arguments.append(f"--blender={program}")
    sentence = f"Joining {join} with {count} slots. Ctrl-C leaves the farm."
    run("worker", early.waiting_command(early.WORKER), token, sentence, arguments, early.take_process(early.WORKER))
