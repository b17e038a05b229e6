"""`rayfarm blender-addon`: writes the Blender add-on that renders on a farm."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from rayfarm.console import err

__all__ = ["register"]

DEFAULT = Path("rayfarm-blender.zip")


def register(app: typer.Typer) -> None:
    """Adds the command to the program."""
    app.command("blender-addon")(blender_addon)


def blender_addon(
    output: Annotated[Path, typer.Option("-o", "--output", help="The archive to write, or a folder for it.")] = DEFAULT,
) -> None:
    """Write the add-on that puts Rayfarm among Blender's render engines.

    To install it in Blender 4.2 or later: Edit > Preferences > Get Extensions, the arrow at the top right, Install from Disk.

    [bold]Examples[/bold]

      rayfarm blender-addon
      rayfarm blender-addon -o ~/Downloads
    """
    from service.addon import addon_zip

    path = output / DEFAULT.name if output.is_dir() else output
    path.write_bytes(addon_zip())
    err.print(
        f"{path}: install it in Blender's preferences, under Get Extensions, by Install from Disk.", markup=False, soft_wrap=True
    )
