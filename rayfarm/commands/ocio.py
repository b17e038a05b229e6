"""`rayfarm ocio`: lists the views of an OpenColorIO config."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from rayfarm import options
from rayfarm.console import out
from renderer.image.ocio import BUILTIN, open_config

__all__ = ["register"]


def register(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command("ocio")(ocio)


def ocio(
    config: options.Ocio = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, for programs.")] = False,
) -> None:
    """List the displays, views and looks of an OpenColorIO config, by their names for --tonemap.

    A view of the default display may be named without the display; a look is appended as /LOOK.

    [bold]Examples[/bold]

      rayfarm ocio
      rayfarm ocio --ocio studio
      rayfarm ocio --ocio /studio/config.ocio
      rayfarm render truck.glb -o truck.png --tonemap ocio:Un-tone-mapped
    """
    found = open_config(config or "")
    default = found.find("ocio").view
    if as_json:
        views = [
            {"name": each.name, "display": each.display, "view": each.view, "default": each == default} for each in found.views
        ]
        print(json.dumps({"config": found.source, "views": views, "looks": found.looks}, indent=1))
        return
    out.print(f"Config: {BUILTIN.get(found.source, found.source)}", markup=False, soft_wrap=True)
    for each in found.views:
        name = f"ocio:{each.view}" if each.is_default else each.name
        out.print(f"  {name}{', or ocio' if each == default else ''}", markup=False, soft_wrap=True)
    if found.looks:
        out.print(f"Looks:  {', '.join(found.looks)}", markup=False, soft_wrap=True)
