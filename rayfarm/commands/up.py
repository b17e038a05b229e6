"""`rayfarm up`: runs a whole farm on this machine."""

from __future__ import annotations

import contextlib
import os
import shlex
import ssl
import sys
import time
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rayfarm.blender import Program, Wanted, program_for
from rayfarm.console import PROGRAM, err, out
from rayfarm.errors import CommandError
from rayfarm.graphics_card import WorkerCards, slot_count
from rayfarm.log_format import LogFormat, use_log_format
from rayfarm.machine import StopSignals, cores, has_screen

if TYPE_CHECKING:
    from rayfarm.local.farm import LocalFarm, Tls

__all__ = ["open_command", "register"]

COMPILING_S = 600.0
NOTE_AFTER_S = 5.0  # kernels from the cache are ready before
LOOPBACK = ("127.0.0.1", "localhost", "::1")


def register(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command("up")(up)


def up(
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port of the page and the API; 0 takes a free one.")] = 8000,
    host: Annotated[
        str, typer.Option(help="Address to listen on; 0.0.0.0 lets other machines open the page and join as workers.")
    ] = "127.0.0.1",
    workers: Annotated[
        int | None,
        typer.Option(
            *("--workers", "--slots"),
            min=0,
            help="Slots of this machine's worker: how many pieces of pictures it renders side by side; by default one per core. "
            "0: no worker here.",
        ),
    ] = None,
    gpu: WorkerCards = "auto",
    data: Annotated[
        Path | None,
        typer.Option(
            file_okay=False,
            help="Where scenes, jobs and films are kept; `up` prints it. [dim]$RAYFARM_DATA[/dim]",
        ),
    ] = None,
    allow_host: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Another name under which the page may be opened, besides IP addresses and this machine's own names; "
            "repeatable.",
        ),
    ] = None,
    tls_cert: Annotated[
        Path | None,
        typer.Option(dir_okay=False, exists=True, help="Serve HTTPS: the certificate with its chain, as PEM."),
    ] = None,
    tls_key: Annotated[Path | None, typer.Option(dir_okay=False, exists=True, help="The certificate's key, as PEM.")] = None,
    blender: Wanted = False,
    blender_program: Program = None,
    log_format: LogFormat = None,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page.")] = True,
) -> None:
    """Start the farm on this machine: a Redis of its own, the service, one worker slot per core, and the page.

    Ctrl-C stops all of it; what was uploaded and rendered is kept, and the next start continues unfinished jobs.

    [bold]Examples[/bold]

      rayfarm up
      rayfarm up --blender             .blend files too
      rayfarm up --port 9000 --workers 4 --data ~/farm
      rayfarm up --host 0.0.0.0        other machines may join, with a login
      rayfarm up --host 0.0.0.0 --allow-host farm.example
    """
    from rayfarm.local.farm import LocalFarm
    from rayfarm.local.state import locked_folder
    from service.locations import default_data_folder

    use_log_format(log_format)
    os.umask(0o077)  # files of a farm are private to its user
    tls = _tls(tls_cert, tls_key)
    signals = StopSignals()
    folder = data.expanduser().resolve() if data else default_data_folder()
    slots = cores() if workers is None else workers
    slot_count(gpu, slots)
    begun = time.monotonic()

    def print_progress(sentence: str) -> None:
        with contextlib.suppress(OSError):  # output to a closed terminal must not prevent the stop
            err.print(sentence, markup=False, soft_wrap=True)

    with locked_folder(folder):
        farm = LocalFarm(
            folder,
            host,
            port,
            slots,
            print_progress,
            allow_host or (),
            tls,
            program_for(blender, blender_program, print_progress),
            gpu,
            open_command(sys.argv[1:]),
        )
        try:
            farm.start(signals.stop)
            if farm.wait_until(farm.service_answers, "service", signals.stop):
                _summary(farm, folder)
                if browser and has_screen():
                    webbrowser.open(farm.login_link(farm.url) or farm.url)
                if slots and farm.wait_until(_with_note(farm.worker_ready), "worker", signals.stop, COMPILING_S):
                    count = "one worker slot" if slots == 1 else f"{slots} worker slots"
                    out.print(f"Ready after {time.monotonic() - begun:.1f} s with {count}. Ctrl-C stops the farm.")
                elif not slots:
                    out.print("Ready without a worker of its own. Ctrl-C stops the farm.")
            while not signals.stop():
                farm.check_parts()
                time.sleep(0.05)
        finally:
            print_progress("Stopping (Ctrl-C again: at once) ...")
            farm.stop(signals.is_immediate)
    print_progress("Stopped. Nothing is left running.")


def _with_note(ready: Callable[[], bool]) -> Callable[[], bool]:
    """Returns `ready` with a note about the compilation of kernels, which is printed once if it is false for NOTE_AFTER_S."""
    begun, is_noted = time.monotonic(), False

    def check() -> bool:
        nonlocal is_noted
        if ready():
            return True
        if not is_noted and time.monotonic() - begun > NOTE_AFTER_S:
            is_noted = True
            out.print("Compiling kernels, about half a minute at the first start. Scenes can be opened meanwhile.")
        return False

    return check


def _tls(certificate: Path | None, key: Path | None) -> Tls | None:
    """Returns the TLS files; None if none are given. Raises CommandError if they cannot be used for HTTPS."""
    from rayfarm.local.farm import Tls

    if certificate is None or key is None:
        if certificate or key:
            raise CommandError("HTTPS needs both: --tls-cert and --tls-key.")
        return None
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key, password="")
    except (ssl.SSLError, OSError) as error:
        why = getattr(error, "reason", None) or error
        raise CommandError(f"{certificate} and {key} are not a PEM certificate and its key without a password ({why}).") from None
    return Tls(certificate.resolve(), key.resolve())


def open_command(arguments: list[str]) -> str:
    """Returns the shell command that starts this farm so that other machines reach it. arguments: those of this process."""
    kept, is_value = [], False
    for each in arguments:
        if not is_value and each != "--host" and not each.startswith("--host="):
            kept.append(each)
        is_value = each == "--host"
    folder = os.environ.get("RAYFARM_DATA")
    variable = f"RAYFARM_DATA={shlex.quote(folder)} " if folder else ""
    return f"{variable}{PROGRAM} {shlex.join([*kept, '--host', '0.0.0.0'])}"


def _summary(farm: LocalFarm, folder: Path) -> None:
    from service.joining import data_variable

    def line(title: str, text: str) -> None:
        out.print(f"  {title:<15} {text}", markup=False, soft_wrap=True)

    out.print(f"\n[bold]Rayfarm[/bold] is up at [bold]{farm.url}[/bold]\n")
    if (link := farm.login_link(farm.public_url)) is not None:
        line("Log in", link)
        program = f"{data_variable(folder)}{PROGRAM}"
        line("", f"(works once, for a day; `{program} user link` prints another, `{program} user add` lets others in)")
    line("First picture", "drop a scene on that page, or open an example there")
    line("API", f"{farm.url}/docs/")
    if farm.host in LOOPBACK:
        line("Add a machine", f"{farm.open_command}, which prints the command for it")
    else:
        line("Add a machine", f"RAYFARM_TOKEN={farm.secrets.token} {PROGRAM} worker --join {farm.public_url}")
    line("Data and logs", f"{folder}\n")
