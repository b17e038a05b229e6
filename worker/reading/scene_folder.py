"""Compiled scenes in a reader's room: the files of the worker's cache, linked by hash into one folder."""

from __future__ import annotations

import os
from pathlib import Path

from renderer.scene.compiled import CompiledScene, load

__all__ = ["folder_of", "placed_scene"]


def folder_of(path: bytes) -> Path:
    """The folder with the path that a slot sent as bytes."""
    return Path(os.fsdecode(path))


def placed_scene(folder: bytes, sha256: str) -> CompiledScene:
    """Maps the compiled scene with this hash in a folder."""
    return load(folder_of(folder) / sha256)
