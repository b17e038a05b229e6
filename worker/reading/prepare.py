"""Reads and compiles a scene, and saves it in parts."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np

from protocol.contract import Manifest, home_camera
from protocol.mesh import encode_mesh
from renderer.confine.reader import Link
from renderer.errors import RayfarmError
from renderer.render import variant_for
from renderer.scene.animation import Moment
from renderer.scene.compile import camera_dicts, compile_scene, summarise
from renderer.scene.compiled_parts import Saver
from renderer.scene.description import SceneDescription
from renderer.scene.frame_reuse import ShotCache
from renderer.scene.load import Shot
from renderer.scene.preview import preview
from worker.reading.scene_folder import folder_of
from worker.reading.thumbnail import thumbnail_settings

__all__ = ["COMPILE", "PREVIEW", "prepare"]

PREVIEW = "preview.mesh"
COMPILE = "compile_kernels"  # function of the slot that returns once the kernels that prepare scenes are cached

log = logging.getLogger(__name__)


def prepare(folder: bytes, manifest: Manifest, out: bytes, link: Link) -> dict[str, Any]:
    """Compiles a scene into the folder `out`, and returns its summary. Raises RayfarmError.

    The summary also has the name of the compiled scene's manifest in `out`, and the kernel variant that renders the scene.
    link: connection to the slot, which receives the progress and a preview. Reading and the preview need none of the kernels
    that take long to compile; before those are needed, the slot's function COMPILE is called.
    """

    def progress(step: str, fraction: float) -> None:
        link.send({"step": step, "fraction": fraction})

    def compiling(step: str, fraction: float) -> None:
        if fraction < 1.0:  # its end is not the preparation's
            progress(step, 0.3 + 0.5 * fraction)

    progress("reading", 0.05)
    shot = Shot(folder_of(folder), manifest.main, manifest.environment, manifest.variant, manifest.up, manifest.floor)
    description = shot.scene_at(Moment(shot.start))
    if (drawn := draw_preview(description, folder_of(out) / PREVIEW)) is not None:
        link.send({"step": "reading", "fraction": 0.3, "preview": drawn})
    link.call_parent(COMPILE)
    kept = ShotCache()
    compiled = compile_scene(description, compiling, shot_cache=kept)
    summary = summarise(description, compiled)
    summary["lights_power"] = kept.lights_power
    assert kept.cuts is not None
    summary["compiled"] = Saver(folder_of(out)).save(compiled, kept.cuts).name  # shares parts with other frames
    shown = summary["cameras"][home_camera(summary["cameras"])]
    summary["variant"] = variant_for(thumbnail_settings(shown["view"], summary["defaults"]), compiled)
    return summary


def draw_preview(description: SceneDescription, path: Path) -> dict[str, Any] | None:
    """Writes the preview mesh to `path`. Returns the scene's cameras, bounds and defaults.

    Returns None if nothing is visible, or if there can be no preview: whether the scene can be rendered, compiling decides.
    """
    try:
        return _drawn_preview(description, path)
    except (RayfarmError, ArithmeticError, LookupError, ValueError, MemoryError) as error:
        log.warning("the scene has no preview: %s: %s", type(error).__name__, error)
        return None


def _drawn_preview(description: SceneDescription, path: Path) -> dict[str, Any] | None:
    mesh = preview(description)
    if mesh is None:
        return None
    path.write_bytes(encode_mesh(mesh))
    bounds = np.stack([mesh.positions.min(axis=0), mesh.positions.max(axis=0)])
    cameras = camera_dicts(description, bounds, mesh.positions)
    return {"cameras": cameras, "bounds": bounds.tolist(), "defaults": dict(description.defaults)}
