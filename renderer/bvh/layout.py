"""The arrays of a built BVH. (Owned by the BVH's author: builder and traversal agree here.)"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy.typing as npt

__all__ = ["Bvh"]


class Bvh(NamedTuple):
    """To be settled by the builder and the traversal."""

    node: npt.NDArray[Any]
