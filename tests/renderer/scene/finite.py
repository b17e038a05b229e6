"""Whether a compiled scene holds finite numbers only."""

import numpy as np

from renderer.arrays.light_rows import CHILD
from renderer.arrays.scene import CompiledScene, flat


def is_finite(scene: CompiledScene) -> bool:
    """Returns True if all arrays except the BVH's are finite. The light tree's integer columns, stored as bits, are skipped."""
    arrays = {name: array for name, array in flat(scene).items() if not name.startswith("bvh.")}
    arrays["light_node"] = scene.light_node[:, :CHILD]
    return all(np.isfinite(array).all() for array in arrays.values())
