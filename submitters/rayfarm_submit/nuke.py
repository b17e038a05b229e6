"""Nuke: fetches a job's finished frames as .exr files, and makes a Read node of them.

from rayfarm_submit import nuke
nuke.read("7f3a1c", "/shots/sh010/render")
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from .farm import Farm, FarmError

__all__ = ["fetch", "read"]


def read(job: str, folder: str, server: str | None = None, token: str | None = None, aov: str = "all") -> Any:
    """Fetches a job's finished frames and returns a Read node of them. Raises FarmError.

    Called again for the same job and folder, it fetches what has been finished since and extends the node that it made.
    """
    import nuke

    pattern, numbers = fetch(job, folder, Farm(server, token), aov)
    name = f"Rayfarm_{job[:8]}"
    node = nuke.toNode(name) or nuke.nodes.Read(name=name)
    node["file"].fromUserText(f"{pattern} {numbers[0]}-{numbers[-1]}")
    for knob, value in (("first", numbers[0]), ("last", numbers[-1]), ("origfirst", numbers[0]), ("origlast", numbers[-1])):
        node[knob].setValue(value)
    return node


def fetch(job: str, folder: str, farm: Farm, aov: str = "all") -> tuple[str, list[int]]:
    """Writes a job's finished frames that are not in the folder yet.

    Returns (the files' pattern with #### for the number, the numbers of all frames that are there). aov: planes, separated by
    commas, or `all`. Raises FarmError, also if no frame is finished.
    """
    numbers = farm.finished_frames(job)
    if not numbers:
        raise FarmError(f"No frame of the job {job} is finished yet.")
    place = Path(folder)
    place.mkdir(parents=True, exist_ok=True)
    for number in numbers:
        path = place / f"{job}.{number:04d}.exr"
        if not path.exists():
            farm.fetch(job, number, path, aov)
    return (place / f"{job}.####.exr").as_posix(), numbers
