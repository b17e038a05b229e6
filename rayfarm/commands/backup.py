"""`rayfarm backup` and `rayfarm restore`: back up the scenes, jobs and films of a data folder, and restore them."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rayfarm.console import PROGRAM, PlainProgress, bar, err, out
from rayfarm.errors import CommandError

if TYPE_CHECKING:
    from service.maintenance.backup import Progress

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Adds the commands to the program."""
    app.command("backup")(backup)
    app.command("restore")(restore)


def backup(
    target: Annotated[Path, typer.Argument(metavar="DIR|FILE", help="A folder, or a file named .tar, .tar.gz or .tar.xz.")],
    data: Annotated[
        Path | None, typer.Option(file_okay=False, help="The farm's data folder; `up` names it. [dim]$RAYFARM_DATA[/dim]")
    ] = None,
) -> None:
    """Back up a farm's scenes, jobs, films and token, even while the farm runs.

    The copy is consistent: the films have at least the samples that the database records, so unfinished jobs can continue. If
    the folder already has a backup, only new files are written, so a nightly backup is quick. Queues, logs and kernels are left
    out, because they are made again.

    [bold]Examples[/bold]

      rayfarm backup /mnt/nas/rayfarm         again: only new files
      rayfarm backup ~/farm-2026-11-22.tar.gz      one file
      rayfarm restore /mnt/nas/rayfarm --data ~/farm && rayfarm up --data ~/farm
    """
    from service.errors import FarmError
    from service.locations import default_data_folder
    from service.maintenance.backup import MANIFEST, back_up
    from service.maintenance.target import target_at

    _only_sqlite()
    folder = data.expanduser().resolve() if data else default_data_folder()
    began = time.monotonic()
    try:
        with _progress_bar("Copying") as progress:
            report = back_up(folder, target_at(target.expanduser(), MANIFEST), progress)
    except FarmError as error:
        raise CommandError(str(error)) from None
    unchanged = f"; {report.unchanged} were there already" if report.unchanged else ""
    out.print(
        f"{_count(report.films, 'film')} and {_count(report.blobs, 'upload or compiled scene', 'uploads and compiled scenes')} "
        f"of {folder} are in {target}{unchanged}. {_megabytes(report.bytes)} were written in {time.monotonic() - began:.1f} s.",
        markup=False,
        soft_wrap=True,
    )
    for sentence in report.lacking:
        err.print(f"rayfarm: {sentence}.", markup=False, soft_wrap=True)
    if report.lacking:
        raise CommandError(
            f"The farm itself lacks what is named above; the rest is backed up. `{PROGRAM} doctor --deep` says more."
        )


def restore(
    source: Annotated[Path, typer.Argument(metavar="DIR|FILE", help="The backup to restore.")],
    data: Annotated[Path, typer.Option(file_okay=False, help="The data folder to create; it must be missing or empty.")],
) -> None:
    """Turn a backup into a data folder; `rayfarm up --data` on it continues unfinished jobs.

    All files are checked against the hashes in the backup before the folder is created. The farm
    that was backed up may keep running.

    [bold]Examples[/bold]

      rayfarm restore /mnt/nas/rayfarm --data ~/farm
      rayfarm up --data ~/farm
    """
    from service.errors import FarmError
    from service.maintenance.restore import restore as bring_back

    folder = data.expanduser().resolve()
    try:
        with _progress_bar("Restoring") as progress:
            manifest = bring_back(source.expanduser(), folder, progress)
    except FarmError as error:
        raise CommandError(str(error)) from None
    made = time.strftime("%Y-%m-%d %H:%M", time.localtime(manifest.made))
    films = sum(name.startswith("films/") for name in manifest.files)
    out.print(f"{folder} has {_count(films, 'film')} and all else of the backup of {made}.", markup=False, soft_wrap=True)
    out.print(f"Start it: {PROGRAM} up --data {folder}", markup=False, soft_wrap=True)


def _only_sqlite() -> None:
    from service.errors import FarmError
    from service.settings import Settings

    try:
        settings = Settings.read()
    except FarmError as error:
        raise CommandError(str(error)) from None
    if settings.database_url and not settings.database_url.startswith("sqlite"):
        raise CommandError(
            "This farm's database is not SQLite (RAYFARM_DATABASE_URL). Back it up with its own tool (pg_dump), and then films/ "
            "and blobs/ of the data folder: in this order, as films only ever gain."
        )
    if settings.blobs:
        raise CommandError(
            "This farm's uploads are in an object store (RAYFARM_BLOBS), which has versions and copies of its own. "
            "Back up rayfarm.sqlite and films/ of the data folder, in this order."
        )


@contextmanager
def _progress_bar(verb: str) -> Iterator[Progress]:
    ticker = PlainProgress()
    with bar() as shown:
        task = shown.add_task(verb, total=None)

        def progress(finished: int, total: int, what: str) -> None:
            shown.update(task, completed=finished, total=total, description=f"{verb} {what}")
            ticker.print_if_due(f"{verb} {what}: {100 * finished // total} %")

        yield progress


def _count(number: int, one: str, plural: str = "") -> str:
    return f"{number} {one if number == 1 else plural or one + 's'}"


def _megabytes(size: int) -> str:
    return f"{size / 1e9:.1f} GB" if size >= 1e9 else f"{size / 1e6:.1f} MB"
