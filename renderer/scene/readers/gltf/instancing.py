"""EXT_mesh_gpu_instancing: nodes that show their mesh many times."""

from __future__ import annotations

import numpy as np

from renderer.errors import SceneError
from renderer.scene.readers.gltf.accessors import Accessors
from renderer.scene.readers.gltf.container import Json
from renderer.scene.readers.gltf.faults import DamagedError
from renderer.scene.readers.gltf.transforms import Matrix, compose
from renderer.sentences import Sentence

__all__ = ["EXTENSION", "instance_transforms"]

EXTENSION = "EXT_mesh_gpu_instancing"

_WIDTHS = {"TRANSLATION": 3, "ROTATION": 4, "SCALE": 3}
_DEFAULTS = {"TRANSLATION": (0.0, 0.0, 0.0), "ROTATION": (0.0, 0.0, 0.0, 1.0), "SCALE": (1.0, 1.0, 1.0)}


def instance_transforms(source: Json, accessors: Accessors, limit: int) -> Matrix:
    """Returns (N, 4, 4) transforms of a node's instances, in the node's space.

    Raises SceneError if there are more than `limit` instances, DamagedError if none is usable.
    """
    attributes = source.object("attributes")
    found = {}
    for key, width in _WIDTHS.items():
        at = attributes.index(key, accessors.accessors) if attributes else None
        if at is not None:
            try:
                count = accessors.accessors[at].integer("count", low=1)
                if count > limit:
                    raise SceneError(
                        Sentence(
                            "gltf-instances-too-many",
                            "{file}: {place} places its mesh {count} times, but only {left} more are allowed; reduce them",
                            file=source.file,
                            place=source.where,
                            count=count,
                            left=limit,
                        )
                    )
                found[key] = accessors.floats(at, width).astype(np.float64)
            except DamagedError as fault:
                source.faults.add(fault)
    counts = {len(values) for values in found.values()}
    if len(counts) != 1:
        raise source.damage(
            "attributes", Sentence("gltf-instancing-arrays-wrong", "has no arrays of transforms, or arrays of different lengths")
        )
    (count,) = counts
    translation, rotation, scale = (found.get(k, np.tile(np.array(_DEFAULTS[k]), (count, 1))) for k in _WIDTHS)
    return compose(translation, rotation, scale)
