"""`rayfarm openjd`: writes a job template of Open Job Description."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer
import yaml

from rayfarm.console import err
from rayfarm.errors import CommandError
from rayfarm.job_template import scene_of, template_of
from rayfarm.output_files import check_writable, write

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command("openjd", context_settings={"ignore_unknown_options": True, "allow_extra_args": True})(openjd)


def openjd(
    context: typer.Context,
    template: Annotated[
        Path | None, typer.Option(metavar="FILE", help="The template to write; by default SCENE.openjd.yaml in this folder.")
    ] = None,
    chunk: Annotated[int, typer.Option(min=1, metavar="N", help="Frames of a task, which one process renders.")] = 1,
    name: Annotated[str | None, typer.Option("--job-name", metavar="NAME", help="By default the scene's file name.")] = None,
) -> None:
    """Write a job template of Open Job Description that renders a scene by `rayfarm render`, some frames to a task.

    SCENE and all further options are those of `rayfarm render`. For farms that run OpenJD, such as AWS Deadline Cloud;
    `rayfarm submit` takes the template too.

    [bold]Examples[/bold]

      rayfarm openjd shot.glb -o out.####.exr --frames 1-250 --spp 256
      rayfarm openjd shot.glb --frames 1-250x5 --chunk 10 --template shot.yaml
      rayfarm submit shot.yaml --param Frames=1-10:2
    """
    if not context.args:
        raise CommandError("Name the scene: `rayfarm openjd SCENE -o out.####.exr --frames 1-250`")
    path = template or Path(f"{scene_of(context.args).resolve().stem}.openjd.yaml")
    found, missing = template_of(context.args, path.parent, chunk, name)
    check_writable(path)
    made_by = f"# rayfarm openjd {shlex.join(context.args)}\n".replace("\n", " ").rstrip() + "\n"
    write(path, (made_by + yaml.safe_dump(found, sort_keys=False, allow_unicode=True, width=120)).encode())
    err.print(f"{path} written", markup=False, soft_wrap=True)
    for each in missing:
        err.print(
            f"note: {each} is not in the template's folder, so it has no default: give the parameter {each} to each job",
            markup=False,
            soft_wrap=True,
        )
