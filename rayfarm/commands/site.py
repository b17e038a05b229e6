"""`rayfarm site`: runs a site's reducer, which adds up the sums of the site's machines before they are sent to the farm."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from protocol.site import SITE_NAME
from rayfarm.errors import CommandError
from rayfarm.joining import farm_address, run, token_to_send
from rayfarm.log_format import LogFormat, use_log_format

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command("site")(site)


def site(
    name: Annotated[str, typer.Argument(help="The site's name; its workers are started with --site NAME.")],
    join: Annotated[str, typer.Option(metavar="URL", help="The farm's address, such as http://host:8000.")],
    token_file: Annotated[
        Path | None,
        typer.Option(dir_okay=False, help="A file with the farm's token, or with a worker's own. [dim]$RAYFARM_TOKEN[/dim]"),
    ] = None,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="The port on which the site's workers reach it; 0 takes a free one.")
    ] = 8010,
    host: Annotated[str, typer.Option(help="The address to listen on; by default all of this machine's.")] = "0.0.0.0",
    address: Annotated[
        str, typer.Option(help="The address workers use for this machine; by default the one it uses towards the farm.")
    ] = "",
    log_format: LogFormat = None,
) -> None:
    """Add up the results of a site's workers for each tile, and send the sum to the farm, until Ctrl-C.

    If many machines are far from the farm, less data travels between them, and the farm has less to receive. Start one on any
    machine of the site, and start the site's workers with --site NAME. While it is down, the workers send their results to the
    farm directly.

    [bold]Examples[/bold]

      rayfarm site attic --join http://studio:8000 --token-file ~/farm.token
      rayfarm worker --join http://studio:8000 --token-file T --site attic
    """
    from renderer.cache_folders import cache_home

    use_log_format(log_format)
    join = farm_address(join)
    if not SITE_NAME.fullmatch(name):
        raise CommandError(f"{name!r} is not a site name; use lower-case letters, digits and . _ -")
    token = token_to_send("A site", "", token_file)
    command = [
        sys.executable,
        "-m",
        "worker.site.reducer",
        "--service",
        join,
        "--name",
        name,
        "--host",
        host,
        "--port",
        str(port),
    ]
    command += ["--folder", str(cache_home() / "sites"), *([f"--address={address}"] if address else [])]
    run("site", command, token, f"Adding up for the site {name} of {join}. Ctrl-C ends it.")
