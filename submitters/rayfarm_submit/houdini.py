"""Houdini: writes the stage of a LOP node as one USD file, and submits it.

from rayfarm_submit import houdini
houdini.submit("/stage/OUT", "$HIP/render", frames="1001-1100", camera="rendercam", options=["--spp", "256"])
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from .farm import FarmError, frames_of, keep_frame_numbers
from .farm import submit as submit_scene

__all__ = ["export", "submit"]


def submit(
    node: str,
    folder: str,
    frames: str | None = None,
    camera: str | None = None,
    size: tuple[int, int] | None = None,
    server: str | None = None,
    options: Sequence[str] = (),
) -> str:
    """Exports a LOP node's stage to FOLDER/NODE.usdc and submits it. Returns the job's id. Raises FarmError.

    The export covers the playbar's range, and so do the frames by default. camera: its prim's name; size: by default the stage's
    RenderSettings.
    """
    import hou

    first, last = (float(frame) for frame in hou.playbar.frameRange())
    path = export(node, folder, first, last)
    return submit_scene(path, frames or frames_of(first, last), camera, size, server, options)


def export(node: str, folder: str, first: float, last: float) -> Path:
    """Writes a LOP node's stage, from frame `first` to `last`, with all layers flattened; returns the file's path.

    Raises FarmError.
    """
    import hou

    source = hou.node(node)
    if source is None:
        raise FarmError(f"There is no node {node}.")
    path = Path(hou.text.expandString(folder)) / f"{source.name()}.usdc"
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = source.parent().createNode("usd_rop")
    try:
        writer.setInput(0, source)
        writer.parm("trange").set("normal")
        for name, value in (("f1", first), ("f2", last), ("f3", 1.0)):
            writer.parm(name).deleteAllKeyframes()  # by default expressions of the playbar's range
            writer.parm(name).set(value)
        writer.parm("lopoutput").set(str(path))
        writer.parm("savestyle").set("flattenalllayers")
        writer.parm("execute").pressButton()
        if writer.errors():
            raise FarmError("; ".join(writer.errors()))
    finally:
        writer.destroy()
    keep_frame_numbers(path)
    return path
