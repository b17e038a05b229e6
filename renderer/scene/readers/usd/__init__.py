"""Reader of Pixar's USD (.usd, .usda, .usdc, .usdz): usd-core composes the stage, which is then read at one moment."""

from __future__ import annotations

import contextlib
from importlib import import_module

from renderer.errors import SceneError
from renderer.scene.animation import Moment
from renderer.scene.description import SceneDescription
from renderer.scene.files import SceneFiles
from renderer.sentences import Sentence

__all__ = ["load", "read"]


def load() -> None:
    """Imports usd-core if it is installed, for processes that fork readers: it takes longer than reading a small stage."""
    with contextlib.suppress(ImportError):
        import_module("renderer.scene.readers.usd.reader")


def read(
    files: SceneFiles, main: str, description: SceneDescription, variant: str | None = None, moment: Moment = Moment()
) -> None:
    """Adds the objects of a USD file at a moment to the description, in metres with Y up.

    variant: the `set=choice` entry of `description.variants` to select; None for the stage's own selections.
    Raises SceneError if usd-core is not installed or the file cannot be read.
    """
    try:
        from renderer.scene.readers.usd.reader import read_stage
    except ImportError as error:
        raise SceneError(
            Sentence(
                "usd-package-not-installed",
                "{file}: USD files need Pixar's usd-core, which is not installed: pip install usd-core. "
                "If it has no wheel for this machine, export glTF (.glb) instead",
                file=main,
            )
        ) from error
    read_stage(files, main, description, variant, moment)
