"""Maya: exports the scene as USD, by Maya's USD plug-in, and submits it with the scene's render settings.

from rayfarm_submit import maya
maya.submit("/shots/sh010/render", options=["--spp", "256"])
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .farm import frames_of, keep_frame_numbers
from .farm import submit as submit_scene

__all__ = ["export", "submit"]

PLUGIN = "mayaUsdPlugin"
GLOBALS, RESOLUTION = "defaultRenderGlobals", "defaultResolution"


def submit(
    folder: str, frames: str | None = None, camera: str | None = None, server: str | None = None, options: Sequence[str] = ()
) -> str:
    """Exports the scene to FOLDER/SCENE.usdc and submits it. Returns the job's id. Raises FarmError.

    Frame range, resolution and camera are those of the render settings: a still where animation is off, and the first renderable
    camera. frames: in place of that range; the export covers the range of the settings. options: further ones of
    `rayfarm submit`.
    """
    from maya import cmds

    first, last, step = _range(cmds)
    path = export(folder, first, last)
    size = (int(cmds.getAttr(f"{RESOLUTION}.width")), int(cmds.getAttr(f"{RESOLUTION}.height")))
    return submit_scene(path, frames or frames_of(first, last, step), camera or _camera(cmds), size, server, options)


def export(folder: str, first: float, last: float) -> Path:
    """Writes the whole scene, from frame `first` to `last`, with its materials as UsdPreviewSurface; returns the file's path."""
    from maya import cmds

    name = Path(cmds.file(query=True, sceneName=True) or "untitled").stem
    path = Path(folder) / f"{name}.usdc"
    path.parent.mkdir(parents=True, exist_ok=True)
    cmds.loadPlugin(PLUGIN, quiet=True)
    cmds.mayaUSDExport(
        file=str(path),
        frameRange=(first, last),
        shadingMode="useRegistry",
        convertMaterialsTo=["UsdPreviewSurface"],
        mergeTransformAndShape=True,
    )
    keep_frame_numbers(path)
    return path


def _range(cmds: Any) -> tuple[float, float, float]:
    """Returns (first, last, step) of the render settings; the present frame where animation is off."""
    if not cmds.getAttr(f"{GLOBALS}.animation"):
        now = float(cmds.currentTime(query=True))
        return now, now, 1.0
    first, last, step = (float(cmds.getAttr(f"{GLOBALS}.{name}")) for name in ("startFrame", "endFrame", "byFrameStep"))
    return first, last, step


def _camera(cmds: Any) -> str | None:
    """Returns the name that the first renderable camera has in USD: of its transform, with _ for the colons of namespaces."""
    for shape in cmds.ls(type="camera", long=True):
        if cmds.getAttr(f"{shape}.renderable"):
            return str(shape).split("|")[-2].replace(":", "_")
    return None
