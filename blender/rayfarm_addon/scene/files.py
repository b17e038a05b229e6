"""Collects the files of an exported scene for upload, and computes their digests."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

from .gltf import FILE, gltf_files
from .model import Scene

__all__ = ["MAIN", "NAME", "Files", "Hashes", "digest_of", "scene_files"]

MAIN = "scene.yaml"
NAME = "blender"  # name of the scene file's shape that contains all meshes
FPS = 24
Files = dict[str, bytes | Path]
Hashes = dict[str, str]

_hashes: dict[tuple[str, int, int], str] = {}  # (path, size, time) of a file -> digest


def scene_files(scene: Scene) -> Files:
    """Returns file name -> content of the exported scene's files. Raises ValueError if there is nothing to render."""
    shapes: list[dict[str, Any]] = []
    files: Files = {}
    if scene.nodes:
        shapes.append({"type": "mesh", "name": NAME, "file": FILE})
        files.update(gltf_files(scene))
        files.update((image.name, image.content) for image in scene.images.values())
    shapes += scene.lamps
    if not shapes:
        raise ValueError("There is nothing to render: no mesh is shown.")
    # The request contains the environment, except for a sky; black prevents studio lighting in a scene without lamps.
    world = scene.world
    environment = {"color": 0} if world.sky is None else {"sky": world.sky, "strength": world.strength}
    said: dict[str, Any] = {"fps": FPS, "environment": environment, "shapes": shapes}
    said |= {"lights": scene.lights} if scene.lights else {}
    said |= {"materials": scene.lamp_materials} if scene.lamp_materials else {}
    said |= {"cameras": scene.cameras} if scene.cameras else {}
    said |= {"medium": world.medium} if world.medium else {}
    files[MAIN] = json.dumps(said, separators=(",", ":")).encode()
    return files


def digest_of(content: bytes | Path) -> str:
    """Returns the SHA-256 digest of bytes or of a file. The digest of a file is cached until its size or time changes."""
    if isinstance(content, bytes):
        return hashlib.sha256(content).hexdigest()
    known = content.stat()
    key = str(content), known.st_size, known.st_mtime_ns
    if key not in _hashes:
        with content.open("rb") as file:
            _hashes[key] = hashlib.file_digest(file, "sha256").hexdigest()
    return _hashes[key]
