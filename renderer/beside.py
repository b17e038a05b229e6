"""What a second process compiles while the first compiles a kernel: `python -m renderer.beside [EDITION]`.

What prepares scenes, and then a part of the kernel for pictures of scenes of that edition (renderer/arrays/has.py), which the
first loads when it comes to it. In this order, since by then the first has compiled what the two parts have in common.
"""

from __future__ import annotations

import sys

from renderer.arrays.edition import only
from renderer.arrays.scene import example
from renderer.jit import rare_collections
from renderer.kernel.accumulate import half_of_pictures
from renderer.preparing import prepare
from renderer.settings import RenderSettings, View

__all__ = ["main"]


def main(editions: list[str]) -> None:
    """For each of the editions, of which there may be none."""
    prepare()
    settings = RenderSettings(2, 2, View((0.2, 0.2, 1.0), (0.2, 0.2, 0.0)))
    for edition in editions:
        half_of_pictures(only(example(), edition), settings)


if __name__ == "__main__":
    with rare_collections():
        main(sys.argv[1:])
