"""Decodes KHR_draco_mesh_compression: primitives whose arrays are in one compressed block."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from renderer.errors import SceneError
from renderer.library_messages import library_message
from renderer.scene.readers.gltf.accessors import MAX_ELEMENTS, Accessors
from renderer.scene.readers.gltf.container import Json
from renderer.sentences import Sentence

__all__ = ["EXTENSION", "decode"]

EXTENSION = "KHR_draco_mesh_compression"


def decode(extension: Json, accessors: Accessors) -> tuple[npt.NDArray[np.int64], dict[str, npt.NDArray[Any]]]:
    """Returns the indices (T * 3,), and the attributes as (V, width) arrays by their glTF names.

    Raises SceneError if DracoPy is not installed or the block is damaged.
    """
    try:
        import DracoPy
    except ImportError as error:
        raise SceneError(
            Sentence(
                "gltf-draco-not-installed",
                "{file} is compressed with Draco; install DracoPy, or export it without compression",
                file=extension.file,
            )
        ) from error
    block = bytes(accessors.view_bytes(extension.integer("bufferView", high=len(accessors.views))))
    try:
        mesh: Any = DracoPy.decode(block)
        faces = np.asarray(mesh.faces, np.int64).reshape(-1)
        found = {int(a["unique_id"]): np.asarray(a["data"]) for a in mesh.attributes}
    except Exception as error:  # the decoder's own errors have no common type
        raise SceneError(
            Sentence(
                "gltf-compressed-data-damaged",
                "{file}: {place} is damaged ({error}); export the file again",
                file=extension.file,
                place=extension.where,
                error=library_message(error),
            )
        ) from error
    if faces.size > 3 * MAX_ELEMENTS:
        raise SceneError(
            Sentence(
                "gltf-triangles-too-many",
                "{file}: {place} contains {triangles} triangles; split the mesh",
                file=extension.file,
                place=extension.where,
                triangles=faces.size // 3,
            )
        )
    names = extension.object("attributes")
    attributes = {}
    for name in names.value if names else ():
        key = names.integer(name) if names else 0
        if key in found:
            attributes[name] = found[key].reshape(len(found[key]), -1)
    return faces, attributes
