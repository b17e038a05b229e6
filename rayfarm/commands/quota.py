"""`rayfarm quota`: shows and sets the limits of users and tokens."""

from __future__ import annotations

import re
from typing import Annotated, Any
from urllib.parse import quote

import typer
from rich.table import Table

from rayfarm import options
from rayfarm.console import out
from rayfarm.errors import CommandError
from rayfarm.login import farm_client
from rayfarm.paged import all_of

__all__ = ["register"]

UNITS = {"": 1, "k": 10**3, "M": 10**6, "G": 10**9, "T": 10**12}
AMOUNT = re.compile(r"([0-9]+(?:\.[0-9]+)?)\s*([kMGT]?)B?")
NONE = "none"
User = Annotated[str, typer.Argument(help="A user; with --token a token's id, as `rayfarm token list` shows it.")]
OfToken = Annotated[bool, typer.Option("--token", help="Limit a token, in addition to its user's limits.")]
quotas = typer.Typer(name="quota", no_args_is_help=True, help="How much users may store and render.")


def register(app: typer.Typer) -> None:
    """Adds the commands to the program."""
    app.add_typer(quotas)


@quotas.command("show")
def show(
    everybody: Annotated[bool, typer.Option("--all", help="List all users' limits; for administrators.")] = False,
    server: options.Server = None,
) -> None:
    """Show your limits and your usage."""
    with farm_client(server) as farm:
        rows = all_of(farm, "/api/quotas") if everybody else farm.call("GET", "/api/quota")
    table = Table("WHOSE", "BYTES", "JOBS AT A TIME", "SAMPLES A DAY", box=None, pad_edge=False)
    for row in rows:
        table.add_row(row["whose"], *(_usage_text(row, name) for name in ("bytes", "jobs", "samples_day")))
    out.print(table if rows else "There are no limits for you.")


@quotas.command("set")
def set_limits(
    name: User,
    bytes: Annotated[str, typer.Option(metavar="N", help="Uploads and films together, such as 50G.")] = NONE,
    jobs: Annotated[str, typer.Option(metavar="N", help="Unfinished jobs at a time.")] = NONE,
    samples_day: Annotated[str, typer.Option(metavar="N", help="Samples of the jobs submitted in 24 hours, such as 2T.")] = NONE,
    token: OfToken = False,
    server: options.Server = None,
) -> None:
    """Set a user's limits; limits that are not given become unlimited.

    [bold]Examples[/bold]

      rayfarm quota set anna --bytes 50G --jobs 20
      rayfarm quota set 98cb8e4eece2 --token --samples-day 1T
    """
    asked = {"bytes": _amount(bytes), "jobs": _amount(jobs), "samples_day": _amount(samples_day)}
    with farm_client(server) as farm:
        farm.call("PUT", _path(name, token), **asked)
    out.print(f"Limits of {name} set.", markup=False)


@quotas.command("reset")
def reset(name: User, token: OfToken = False, server: options.Server = None) -> None:
    """Reset a user to the farm's default limits, or a token to its user's limits."""
    with farm_client(server) as farm:
        farm.call("DELETE", _path(name, token))
    out.print(f"Limits of {name} removed.", markup=False)


def _path(name: str, token: bool) -> str:
    return f"/api/quotas/{'tokens' if token else 'users'}/{quote(name, safe='')}"


def _amount(text: str) -> int | None:
    if text == NONE:
        return None
    found = AMOUNT.fullmatch(text.strip())
    if found is None:
        raise CommandError(f"{text!r} is not an amount; give a number such as 20, 50G or 2T")
    return round(float(found[1]) * UNITS[found[2]])


def _usage_text(row: dict[str, Any], name: str) -> str:
    used, limit = row["used"][name], row["limits"][name]
    return f"{used:,}" if limit is None else f"{used:,} of {limit:,}"
