"""`python -m renderer.cuda`: builds the PTX of kernel variants into the cache, without a GPU; prints each file's path."""

from __future__ import annotations

import argparse
import time

from renderer.arrays.scene_features import KERNEL_VARIANTS
from renderer.cuda.artefacts import path_of, ptx_of
from renderer.cuda.cards import NOT_YET_TRIED
from renderer.printable import printable

__all__ = ["main"]


def main() -> None:
    """Builds the PTX of the kernel variants that are missing in the cache."""
    parser = argparse.ArgumentParser(
        prog="python -m renderer.cuda", description=f"Builds the kernels for NVIDIA cards, without a card ({NOT_YET_TRIED})."
    )
    parser.add_argument("variants", nargs="*", metavar="VARIANT", help=f"of {', '.join(KERNEL_VARIANTS)}; by default all")
    wanted = parser.parse_args().variants or list(KERNEL_VARIANTS)
    if unknown := [name for name in wanted if name not in KERNEL_VARIANTS]:
        parser.error(f"there is no kernel {', '.join(unknown)}; known are {', '.join(KERNEL_VARIANTS)}")
    for variant in wanted:
        begin = time.perf_counter()
        size = len(ptx_of(variant))
        print(printable(f"{variant}: {size / 1e6:.1f} MB, {time.perf_counter() - begin:.1f} s, {path_of(variant)}"), flush=True)


if __name__ == "__main__":
    main()
