"""`rayfarm dataset`: renders a data set that a YAML file describes."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from rayfarm.console import PlainProgress, bar, err
from rayfarm.datasets.document import dataset_of_file
from rayfarm.login import farm_client

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command("dataset")(dataset)


def dataset(
    file: Annotated[Path, typer.Argument(help="A YAML file: scene, cameras, outputs, folder ... as in the guide on data sets.")],
    server: Annotated[
        str | None, typer.Option(metavar="URL", help="The farm that renders the views; by default this process.")
    ] = None,
) -> None:
    """Render many views of a scene with exact annotation: depth, ids, boxes, masks, flow.

    Views are written as they are finished. If it is interrupted, the same command continues.

    [bold]Examples[/bold]

      rayfarm dataset room.yaml
      rayfarm dataset room.yaml --server http://studio:8000
    """
    ticker = PlainProgress()
    with ExitStack() as stack:
        farm = stack.enter_context(farm_client(server)) if server is not None else None
        progress = stack.enter_context(bar("views"))
        task = progress.add_task("rendering", total=None)

        def show_progress(done: int, total: int) -> None:
            progress.update(task, completed=done, total=total)
            ticker.print_if_due(f"rendering: {done} of {total} views")

        made = dataset_of_file(file, farm, show_progress)
    err.print(f"{made.folder}: {len(made.views)} views", markup=False, soft_wrap=True)
