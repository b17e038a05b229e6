"""Scenes that Blender has to convert: workers with Blender fetch them from a separate queue and upload the converted files.

Afterwards the scene consists of the converted files, and any worker can prepare it and its frames.
"""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import Any

from protocol.contract import BlobRef, prepare_queue
from renderer.formats import BY_BLENDER, WITHOUT_BLENDER
from renderer.sentences import Sentence

__all__ = ["TAG", "WAITS_FOR_BLENDER", "blender_queue", "converted_files", "is_blend"]

TAG = "blender"  # tag in the offer of a worker with Blender
WAITS_FOR_BLENDER = Sentence(
    "waits-for-blender-worker",
    "Waits for a worker with Blender, which .blend and .abc files need: none is connected. "
    "Start one: `rayfarm worker --blender`, or for a farm on this machine `rayfarm up "
    "--blender`. {without_blender}.",
    without_blender=WITHOUT_BLENDER,
)


def is_blend(main: str) -> bool:
    """Returns True if Blender has to open the scene, judged by the name `main` of its main file."""
    return PurePosixPath(main).suffix.lower() in BY_BLENDER


def blender_queue(kind: str) -> str:
    """Returns the Celery queue for preparing scenes that Blender has to open. kind: the worker kind (renderer.jit.kind).

    Only workers of this kind that have Blender serve it.
    """
    return f"{prepare_queue(kind)}.{TAG}"


def converted_files(info: dict[str, Any] | None) -> tuple[str, list[BlobRef]] | None:
    """Returns the name of the main file and the references to all files that Blender wrote when it converted a scene.

    None if the scene was not converted. info: the scene's SceneInfo as a dict. Raises ValueError if it is malformed.
    """
    blend = (info or {}).get("blend")
    if not blend:
        return None
    if not isinstance(blend, dict) or not isinstance(blend.get("main"), str) or not isinstance(blend.get("files"), list):
        raise ValueError("Blender's output cannot be parsed")
    return blend["main"], [BlobRef.from_json(ref) for ref in blend["files"]]
