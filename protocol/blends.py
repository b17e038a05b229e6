"""Scenes that Blender has to convert first: workers with Blender take them from a separate queue and upload the converted files.

From then on the converted files are the scene: any worker can prepare it and its frames, like any other scene.
"""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import Any

from protocol.contract import BlobRef, prepare_queue
from renderer.formats import BY_BLENDER, WITHOUT_BLENDER
from renderer.sentences import Sentence

__all__ = ["TAG", "WAITS", "blender_queue", "is_blend", "written_of"]

TAG = "blender"  # tag in the offer of a worker with Blender
WAITS = Sentence(
    "waits-for-blender-worker",
    "Waits for a worker with Blender, which alone opens .blend and .abc files: none is "
    "connected. Start one: `rayfarm worker --blender`, or for a farm of this machine "
    "`rayfarm up --blender`. Or {without_blender}.",
    without_blender=WITHOUT_BLENDER,
)


def is_blend(main: str) -> bool:
    """Returns True if Blender has to open a scene's main file."""
    return PurePosixPath(main).suffix.lower() in BY_BLENDER


def blender_queue(kind: str) -> str:
    """The Celery queue for preparing scenes that Blender has to open, on workers of this kind that have it."""
    return f"{prepare_queue(kind)}.{TAG}"


def written_of(info: dict[str, Any] | None) -> tuple[str, list[BlobRef]] | None:
    """The files that Blender wrote for a scene, as (main file, all files), from its SceneInfo as a dict; None if it wrote none.

    Raises ValueError if the entry is malformed.
    """
    blend = (info or {}).get("blend")
    if not blend:
        return None
    if not isinstance(blend, dict) or not isinstance(blend.get("main"), str) or not isinstance(blend.get("files"), list):
        raise ValueError("what Blender wrote of the scene cannot be made out")
    return blend["main"], [BlobRef.from_json(ref) for ref in blend["files"]]
