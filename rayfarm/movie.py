"""`rayfarm render --frames -o out.mp4`: renders the frames to pictures in a folder next to the movie, then encodes them."""

from __future__ import annotations

import contextlib
import hashlib
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image

from rayfarm.console import err
from rayfarm.errors import CommandError
from rayfarm.frame import PictureOrder
from rayfarm.reading import ConfinedScene
from rayfarm.sequence import Sequence, render_sequence
from renderer.errors import RayfarmError
from service.watching.movie import write_movie

__all__ = ["render_movie"]


def render_movie(shot: Sequence, stage: ConfinedScene, order: PictureOrder, about: object) -> dict[str, Any]:
    """Like `render_sequence`, but writes a movie to `shot.output`.

    The frames stay in a folder next to it until all have succeeded, so the same command continues an interrupted run. about:
    everything that the pictures depend on; it selects the folder, so other commands use other folders.
    """
    name = hashlib.sha256(repr((shot.scene.resolve(), replace(shot.moment, frame=0.0), about)).encode()).hexdigest()[:12]
    folder = shot.output.with_name(f".{shot.output.name}.{name}")
    folder.mkdir(exist_ok=True)
    pictures = replace(shot, output=folder / "####.png")
    try:
        found = render_sequence(pictures, stage, order)
    finally:
        with contextlib.suppress(OSError):
            folder.rmdir()  # only if it is empty
    there = [path for path in map(pictures.file, shot.frames) if path.is_file()]
    if not there:
        raise CommandError(f"{shot.output}: no frame could be rendered, so there is no movie")
    part = folder / f"film{shot.output.suffix}"
    write_movie(part, _read(there), _fps(pictures, stage, found))
    part.replace(shot.output)
    if not found["failed"]:
        shutil.rmtree(folder, ignore_errors=True)
    err.print(f"{shot.output} written, of {len(there)} frames", markup=False, soft_wrap=True)
    return found


def _read(paths: list[Path]) -> Iterator[npt.NDArray[np.uint8]]:
    for path in paths:
        with Image.open(path) as image:
            yield np.asarray(image.convert("RGB"))


def _fps(shot: Sequence, stage: ConfinedScene, found: dict[str, Any]) -> float:
    """Returns the frame rate: the requested one, else the file's own, else 24."""
    if shot.moment.fps is not None:
        return shot.moment.fps
    for frame in found["frames"]:
        return float(frame["fps"])
    with contextlib.suppress(RayfarmError):
        return float(stage.scene_at(replace(shot.moment, frame=shot.frames[0]))[1]["fps"])
    return 24.0
