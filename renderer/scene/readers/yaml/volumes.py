"""Reads the volumes of a scene file: density and emission grids from files, and where they are."""

from __future__ import annotations

from typing import Any

import numpy as np

from renderer.errors import SceneError
from renderer.scene.description import F32, Volume
from renderer.scene.files import SceneFiles
from renderer.scene.readers.volume_files import read_volume
from renderer.scene.readers.yaml.lines import Path, Yaml
from renderer.scene.readers.yaml.transforms import joined, matrix
from renderer.scene.readers.yaml.values import radiance
from renderer.sentences import Sentence

__all__ = ["read_scene_volume"]


def read_scene_volume(source: dict[str, Any], document: Yaml, files: SceneFiles, path: Path) -> Volume:
    """Returns a volume of a scene file. Raises SceneError, with its line, if a grid is missing or invalid."""
    low, high = np.array(source.get("bounds", ((0, 0, 0), (1, 1, 1))), np.float64)
    if not (high > low).all():
        raise document.error(
            (*path, "bounds"),
            Sentence("volume-bounds-empty", "its second corner must be greater than its first along each axis"),
        )
    place = np.diag((*(high - low), 1.0))
    place[:3, 3] = low
    if "transform" in source:
        place = joined(matrix(source["transform"], document, (*path, "transform")), place, document, (*path, "transform"))
    density = _grid(source["density"], document, files, (*path, "density"))
    emission = _grid(source["emission"], document, files, (*path, "emission")) if "emission" in source else None
    return Volume(density, place, emission, radiance(source.get("emission_color", 1)))


def _grid(reference: str, document: Yaml, files: SceneFiles, path: Path) -> F32:
    name = files.find(reference, document.file)
    if name is None:
        raise document.error(
            path, Sentence("file-not-in-scene", "{name} is not among the scene's files; add it", name=reference[:200])
        )
    try:
        return files.get_or_make(("volume", name), lambda: read_volume(files.read(name), name))
    except SceneError as error:
        raise document.error(path, error.args[0]) from error
