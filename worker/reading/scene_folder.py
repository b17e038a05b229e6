"""Compiled scenes for a confined reader: files of the worker's cache, linked by their hashes into one folder."""

from __future__ import annotations

import os
from pathlib import Path

from renderer.scene.compiled import CompiledScene, load

__all__ = ["folder_of", "mapped_scene"]


def folder_of(path: bytes) -> Path:
    """Returns a folder or file as a Path. path: as bytes, which is how the slot sends it."""
    return Path(os.fsdecode(path))


def mapped_scene(folder: bytes, sha256: str) -> CompiledScene:
    """Maps the compiled scene with this hash in a folder."""
    return load(folder_of(folder) / sha256)
