"""Checks whether a compiled scene contains only finite numbers."""

import numpy as np

from renderer.arrays.light_rows import CHILD
from renderer.arrays.scene import CompiledScene, flat


def is_finite(scene: CompiledScene) -> bool:
    """Returns whether all float arrays of the scene, except the BVH's, are finite.

    Integer columns of the light tree, which are stored as the bits of floats, are skipped.
    """
    arrays = {name: array for name, array in flat(scene).items() if not name.startswith("bvh.")}
    arrays["light_node"] = scene.light_node[:, :CHILD]
    return all(np.isfinite(array).all() for array in arrays.values())
