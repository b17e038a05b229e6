"""Lights that requests choose for a scene, for its preview mesh, which the page draws before there are samples."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from protocol.mesh import MESH, decode_light
from renderer.image import rgbe9995
from service.farm import Farm
from service.jobs.lookup import find_scene
from service.scheduling.artifacts.scene_preparation import Progress
from service.store.models import Scene

__all__ = ["PreviewLight", "current_preview", "preview_light"]

TABLES = Path(__file__).parent.parent / "light_pictures" / "radiance.npz"  # of the presets; made by scenes/light_pictures.py


class PreviewLight(NamedTuple):
    """Light of a preview mesh. words: RGB9E5, rows from the top; empty if it is black. lamps: with the sun, if there is one."""

    width: int
    height: int
    words: bytes
    lamps: list[dict[str, Any]]


def preview_light(scene: str, request: Mapping[str, Any], farm: Farm) -> PreviewLight | None:
    """Returns the light of a scene with the request's `environment`, `variant`, `up` and `floor`, neither turned nor scaled.

    Presets without a sun are tabulated. Other lights are those that a worker has read for a view; None until then, and if its
    file cannot be decoded.
    """
    base = find_scene(scene, farm)
    preset = (request.get("environment") or {}).get("preset")
    if preset in _preset_lights():
        return _preset_lights()[preset]
    preparing = farm.engine.snapshot.preparing
    row = farm.lighting.find_row(scene, request)
    ref = None if row is None else current_preview(row, preparing.get(row.id), farm)
    # Workers of earlier releases kept the preview of the scene's own light.
    if row is None or ref is None or (row.of is not None and ref == (base.info or {}).get("preview")):
        return None
    try:
        head, words, lamps = decode_light(farm.blobs.serve(ref["sha256"]).chunks)
    except (KeyError, TypeError, ValueError):  # a worker's file is untrusted
        return None
    return PreviewLight(head.width, head.height, words, lamps)


def current_preview(scene: Scene, progress: Progress | None, farm: Farm) -> dict[str, Any] | None:
    """Returns the reference of a scene's preview mesh; None if there is none in the present layout, which the page reads.

    progress: of its preparation, looked up before its row: it ends once the row has the preview.
    """
    ref = (scene.info or {}).get("preview") or (asdict(progress.preview.preview) if progress and progress.preview else None)
    if not ref:
        return None
    try:
        MESH.unpack(next(iter(farm.blobs.serve(ref["sha256"]).chunks), b""))
    except ValueError:
        return None
    return ref


@functools.cache
def _preset_lights() -> dict[str, PreviewLight]:
    with np.load(TABLES) as tables:
        return {name: _grey_light(tables[name].astype(np.float32)) for name in tables.files}


def _grey_light(radiance: np.ndarray) -> PreviewLight:
    height, width = radiance.shape
    words = rgbe9995.pack(np.repeat(radiance[..., None], 3, axis=2)).astype("<u4").tobytes()
    return PreviewLight(width, height, words, [])
