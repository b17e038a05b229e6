"""Reads single files in a confined process (renderer/confine/); and the limits of all confined processes of the command line."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from renderer.confine.job_folder import temporary_folder
from renderer.confine.limits import available_memory
from renderer.confine.running import Bounds, run
from renderer.errors import SceneError, SettingsError

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["SECONDS", "bounds_of", "read_picture", "usd_names"]

SECONDS = "RAYFARM_READ_SECONDS"
_SECONDS = 600.0
_LEAST_MEMORY = 1 << 30
_FILES = ("rayfarm.reader_jobs",)


def read_picture(data: bytes, name: str) -> npt.NDArray[Any]:
    """Returns the pixels of an image file, like renderer.image.read.read. Raises RayfarmError."""
    import numpy as np

    from rayfarm.reader_jobs import picture

    with temporary_folder("rayfarm-read-") as room:
        image, pixels, out = room / "image", room / "out" / "pixels", room / "out"
        out.mkdir()
        image.write_bytes(data)
        job = partial(picture, os.fsencode(image), name, os.fsencode(pixels))
        found = run(job, [image], [out], bounds_of(name), preload=_FILES)
        try:
            dtype = {"|u1": np.uint8, "<u2": np.uint16, "<f4": np.float32}[found["dtype"]]
            return np.fromfile(pixels, dtype).reshape(found["shape"])
        except (OSError, KeyError, TypeError, ValueError) as error:
            raise SceneError(f"{name} cannot be read: its importer ended without a result.") from error


def usd_names(layer: Path) -> list[str]:
    """Returns the names of the files that a USD layer refers to.

    Returns an empty list if the layer cannot be read; reading the scene later reports that.
    """
    from rayfarm.reader_jobs import usd_names as work

    with temporary_folder("rayfarm-read-") as room:
        job = partial(work, os.fsencode(layer.resolve()))
        try:
            return [str(name) for name in run(job, [layer.resolve()], [room], bounds_of(layer.name), preload=_FILES)["names"]]
        except SceneError:
            return []


def bounds_of(subject: str) -> Bounds:
    """Returns the memory and time limits for a confined process on this machine. Raises SettingsError for an invalid
    $RAYFARM_READ_SECONDS.
    """
    try:
        seconds = float(os.environ.get(SECONDS) or _SECONDS)
        if not 0 < seconds < 1e7:
            raise ValueError
    except ValueError:
        raise SettingsError(f"{SECONDS} is {os.environ[SECONDS]!r}; it takes a number of seconds, such as 1800") from None
    memory = max(available_memory() * 9 // 10, _LEAST_MEMORY)
    return Bounds(memory, seconds, subject, longer=f"Make it smaller, or set {SECONDS} to a longer time.")
