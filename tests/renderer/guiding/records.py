"""Records as pilot paths would write them, for tests of what is made from them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from renderer.kernel.guiding.pilot import (
    RECORD_COLUMNS,
    RECORD_DIRECTION,
    RECORD_INDIRECT,
    RECORD_LINKED,
    RECORD_NEAR,
    RECORD_NORMAL,
    RECORD_POINT,
    RECORD_SCALE,
)

__all__ = ["NO_PHOTONS", "made_records"]

NO_PHOTONS = np.zeros((0, RECORD_COLUMNS), np.float32)


def made_records(count: int, seed: int = 1) -> npt.NDArray[np.float32]:
    """Returns the records of `count` paths of two vertices each on the floor of a room, (2 * count, RECORD_COLUMNS).

    Most light comes from one direction, the rest from all of the upper hemisphere.
    """
    random = np.random.default_rng(seed)
    records = np.zeros((2 * count, RECORD_COLUMNS), np.float32)
    records[:, RECORD_POINT : RECORD_POINT + 3] = random.random((2 * count, 3)) * (4, 0, 4)
    records[:, RECORD_NORMAL + 1] = 1
    from_lamp = random.random(2 * count) < 0.3
    d = random.normal(size=(2 * count, 3))
    d[from_lamp] = d[from_lamp] * 0.02 + (0.6, 0.7, 0.3)
    d[:, 1] = np.abs(d[:, 1])
    records[:, RECORD_DIRECTION : RECORD_DIRECTION + 3] = d / np.linalg.norm(d, axis=1, keepdims=True)
    records[:, RECORD_NEAR] = np.where(from_lamp, 5.0, 0.1) * random.random(2 * count)
    records[:, RECORD_SCALE] = 3.0
    records[:, RECORD_INDIRECT] = random.exponential(0.1, 2 * count)
    records[::2, RECORD_LINKED] = 1
    return records
