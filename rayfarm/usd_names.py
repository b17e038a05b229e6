"""The files that binary USD layers refer to, read in a confined process."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path

from renderer.confine.place import temporary_folder
from renderer.confine.running import Bounds, run
from renderer.errors import SceneError

__all__ = ["usd_names"]

_BOUNDS = Bounds(4 << 30, 120.0)


def usd_names(layer: Path) -> list[str]:
    """Names in a layer; none where it cannot be read: whoever reads the scene reports that. Raises MachineError."""
    from rayfarm.read import usd_names as work

    with temporary_folder("rayfarm-read-") as room:
        job = partial(work, os.fsencode(layer.resolve()))
        try:
            return [str(name) for name in run(job, [layer.resolve()], [room], _BOUNDS, preload=["rayfarm.read"])["names"]]
        except SceneError:
            return []
