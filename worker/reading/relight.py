"""Compiles only the environment of a scene, for other environment lighting, and writes it for the page's preview."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from protocol.mesh import encode_mesh
from renderer.confine.reader import Link
from renderer.preview_mesh import PreviewMesh
from renderer.scene.compiled import CompiledScene
from renderer.scene.compiled_parts import save_changed
from renderer.scene.description import SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.load import environment_light
from renderer.scene.preview_light import environment_texels, lamps_of
from renderer.scene.relight import CHANGED_ARRAYS, replace_environment
from worker.reading.prepare import PREVIEW
from worker.reading.scene_folder import folder_of, mapped_scene

__all__ = ["relight", "save_relit"]


def relight(folder: bytes, light: str, base_folder: bytes, base: str, power: float, out: bytes, link: Link) -> dict[str, Any]:
    """Compiles a scene with another environment. Returns the name of its manifest in `out` as `compiled`.

    light: the environment: name of an image in `folder`, or of a preset. base: hash of the compiled scene to start from, in
    `base_folder`. power: total power of the scene's other lights. link: connection to the slot.
    """
    data = (folder_of(base_folder) / base).read_bytes()
    return {"compiled": save_relit(folder_of(folder), light, mapped_scene(base_folder, base), data, power, folder_of(out)).name}


def save_relit(folder: Path, light: str, base: CompiledScene, data: bytes, power: float, out: Path) -> Path:
    """Writes the parts of a compiled scene that a new environment changes, and its manifest. Returns the manifest's path.

    Also writes the file PREVIEW: a mesh without triangles, with the environment and the sun.

    light: name of an image in `folder`, or of a preset. base, data: the compiled scene to start from, and its manifest. power:
    total power of the scene's other lights. out: the output folder.
    """
    description = SceneDescription(name="light")
    environment_light(SceneFiles(folder, light), light, description)
    (out / PREVIEW).write_bytes(encode_mesh(_light_alone(description, np.asarray(base.bounds, np.float64))))
    return save_changed(data, replace_environment(base, description, power), CHANGED_ARRAYS, out)


def _light_alone(description: SceneDescription, bounds: npt.NDArray[np.float64]) -> PreviewMesh:
    """Returns a preview mesh of one vertex and the description's light. bounds: (2, 3), of the scene."""
    vertex = np.zeros((1, 3))
    return PreviewMesh(
        vertex,
        vertex.astype(np.float32),
        np.zeros((1, 4), np.uint8),
        np.zeros((0, 3), np.uint32),
        lamps=lamps_of(description, bounds),
        environment=environment_texels(description, in_studio=False),
    )
