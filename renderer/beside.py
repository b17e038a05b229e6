"""What a second process compiles while the first compiles a kernel: `python -m renderer.beside [EDITION]`.

A part of the kernel for pictures of scenes of that edition (renderer/arrays/has.py), which the first loads when it comes to it,
and then what prepares scenes.
"""

from __future__ import annotations

import sys

from renderer.arrays.edition import only
from renderer.arrays.scene import example
from renderer.kernel.accumulate import half_of_pictures
from renderer.preparing import prepare
from renderer.settings import RenderSettings, View

__all__ = ["main"]


def main(editions: list[str]) -> None:
    """For each of the editions, of which there may be none."""
    settings = RenderSettings(2, 2, View((0.2, 0.2, 1.0), (0.2, 0.2, 0.0)))
    for edition in editions:
        half_of_pictures(only(example(), edition), settings)
    prepare()


if __name__ == "__main__":
    main(sys.argv[1:])
