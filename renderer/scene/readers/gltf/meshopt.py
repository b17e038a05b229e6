"""Decodes buffer views compressed by EXT_meshopt_compression, or KHR_meshopt_compression, which has the same fields."""

from __future__ import annotations

from typing import Any

import numpy as np

from renderer.errors import SceneError
from renderer.library_messages import library_message
from renderer.scene.readers.gltf.container import Json
from renderer.sentences import Sentence

__all__ = ["EXTENSIONS", "decode", "extension_of"]

EXTENSIONS = ("EXT_meshopt_compression", "KHR_meshopt_compression")
_MODES = ("ATTRIBUTES", "TRIANGLES", "INDICES")
_FILTERS = ("NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", "COLOR")
MAX_BYTES = 2 << 30


def extension_of(view: Json) -> Json | None:
    """Returns the compression extension of a buffer view; None if it is not compressed."""
    return next((found for name in EXTENSIONS if (found := view.extension(name))), None)


def decode(extension: Json, packed: memoryview, length: int) -> memoryview:
    """Returns the `length` decompressed bytes of a buffer view.

    Raises SceneError if meshopt is not installed or the data is damaged.
    """
    try:
        import meshopt
    except ImportError as error:
        raise SceneError(
            Sentence(
                "gltf-meshopt-not-installed",
                "{file} is compressed with meshopt; install the package meshopt, or export it without",
                file=extension.file,
            )
        ) from error
    count, stride = extension.integer("count"), extension.integer("byteStride", low=1, high=257)
    mode, filter = extension.text("mode", ""), extension.text("filter", "NONE")
    if mode not in _MODES or filter not in _FILTERS:
        raise extension.damage(
            "mode",
            Sentence(
                "gltf-meshopt-filter-unknown", "or filter is unknown ({mode}, {filter})", mode=mode[:20], filter=filter[:20]
            ),
        )
    if count * stride != length or length > MAX_BYTES:
        raise extension.damage(
            "count",
            Sentence("gltf-meshopt-length-wrong", "and byteStride do not match the {length} bytes of the view", length=length),
        )
    if count == 0:
        return memoryview(b"")
    try:
        found: Any = meshopt.decode_gltf_buffer(bytes(packed), count, stride, mode, filter)
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
    made = np.ascontiguousarray(found)
    if mode != "ATTRIBUTES":
        made = made.reshape(-1).astype({2: np.uint16, 4: np.uint32}.get(stride, made.dtype))
    data = made.tobytes()
    if len(data) != length:
        raise SceneError(
            Sentence(
                "gltf-meshopt-data-damaged",
                "{file}: {place} is damaged; export the file again",
                file=extension.file,
                place=extension.where,
            )
        )
    return memoryview(data)
