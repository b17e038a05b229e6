"""`rayfarm workers`: lists workers, and changes their settings at run time."""

from __future__ import annotations

from typing import Annotated, Any
from urllib.parse import quote

import typer
from rich.markup import escape
from rich.table import Table

from rayfarm import options
from rayfarm.console import out
from rayfarm.errors import CommandError
from rayfarm.login import farm_client
from rayfarm.responses import Card, Worker
from rayfarm.watch.words import format_count

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command("workers")(workers)


def workers(
    name: Annotated[str | None, typer.Argument(help="The worker to change; by default all are listed.")] = None,
    hours: Annotated[
        str | None, typer.Option(metavar="WEEK", help="When it works, such as 'Mon-Fri 19:00-07:00, Sat-Sun'; '' for always.")
    ] = None,
    idle: Annotated[
        float | None,
        typer.Option(
            min=0, metavar="MINUTES", help="Accept work only after the machine has been unused for this long; 0: always."
        ),
    ] = None,
    nice: Annotated[
        int | None, typer.Option(min=0, max=19, help="Its nice level: higher leaves more of the machine to other programs.")
    ] = None,
    slots: Annotated[int | None, typer.Option(min=1, help="The most slots it uses; never more than it was started with.")] = None,
    memory: Annotated[float | None, typer.Option(min=0, metavar="GB", help="Memory that it may use; 0: no limit.")] = None,
    pause: Annotated[bool, typer.Option("--pause", help="Finish the batches in progress and accept no more.")] = False,
    resume: Annotated[bool, typer.Option("--resume", help="Accept work again, even after a quarantine.")] = False,
    reset: Annotated[
        bool, typer.Option("--reset", help="Reset hours, limits and nice level to the worker's start values.")
    ] = False,
    server: options.Server = None,
) -> None:
    """List a farm's workers, or change one while it runs. Changes take effect within seconds; batches in progress are finished.

    [bold]Examples[/bold]

      rayfarm workers
      rayfarm workers attic --hours "Mon-Fri 19:00-07:00, Sat-Sun" --nice 10
      rayfarm workers attic --slots 4 --memory 16
      rayfarm workers attic --reset --resume
    """
    said: dict[str, Any] = {"hours": hours, "idle_minutes": idle, "nice": nice, "slots": slots, "memory_gb": memory}
    asked = dict.fromkeys(said) if reset else {}
    asked |= {key: value for key, value in said.items() if value is not None}
    if pause and resume:
        raise CommandError("Give --pause or --resume, not both")
    if pause or resume:
        asked["state"] = "paused" if pause else "running"
    if asked and name is None:
        raise CommandError("Say which worker: `rayfarm workers NAME --slots 4`")
    with farm_client(server) as farm:
        if name is not None and asked:
            farm.call("PATCH", f"/api/workers/{quote(name, safe='')}", **asked)
            out.print(f"The change is sent to {name}; it takes effect within seconds.", markup=False)
            return
        rows = [row for row in farm.workers() if name in (None, row.name)]
    if not rows:
        raise CommandError(f"There is no worker {name!r}") if name else CommandError("No worker is connected")
    table = Table("WORKER", "STATE", "VIA", "SLOTS", "WORKS", "NICE", "MEMORY", "TAGS", box=None, pad_edge=False)
    for row in rows:
        table.add_row(*map(escape, _cells(row)))
    out.print(table)
    for row in rows:
        for card in row.cards:
            out.print(f"{row.name}: {_card_line(card)}", markup=False, soft_wrap=True)
        for reason in row.cards_unused:
            out.print(f"{row.name}: {reason}", markup=False, soft_wrap=True)
        old = "" if row.state == "starting" else "is of an older release: it can only be paused"
        for why in (row.message, row.offer.trouble if row.offer else old):
            if why:
                out.print(f"{row.name}: {why}", markup=False, soft_wrap=True)


def _card_line(card: Card) -> str:
    speed = f", {format_count(card.samples_per_s)} samples/s" if card.samples_per_s else ""
    return f"renders with card {card.number}: {card.name}, {card.memory / 2**30:.0f} GiB{speed}"


def _cells(row: Worker) -> list[str]:
    offer, via = row.offer, "HTTPS" if row.transport == "https" else "Redis"
    if offer is None:
        return [row.name, row.state, via, str(row.slots), "always", "", "", ""]
    works = offer.hours or "always"
    if offer.idle_minutes:
        works += f", idle {offer.idle_minutes:g} min"
    slots = str(row.slots) if row.slots == offer.slots_most else f"{row.slots} of {offer.slots_most}"
    tags = " ".join(tag for tag in offer.tags if not tag.startswith(("kind:", "host:")))
    return [row.name, row.state, via, slots, works, str(offer.nice), f"{offer.memory / 1e9:.1f} GB", tags]
