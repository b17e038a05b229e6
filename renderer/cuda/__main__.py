"""`python -m renderer.cuda`: builds the PTX of kernel variants into the cache, without a GPU; prints each file's path.

Those for pictures by wavelength are built with `--spectral` alone, else at their first use.
"""

from __future__ import annotations

import argparse
import time

from renderer.arrays.scene_features import KERNEL_VARIANTS
from renderer.cuda.artefacts import path_of, ptx_of
from renderer.cuda.cards import NOT_YET_TRIED
from renderer.printable import printable
from renderer.variant_names import SPECTRAL_SUFFIX

__all__ = ["main"]

_PLAIN, *_ = KERNEL_VARIANTS


def main() -> None:
    """Builds the PTX of the kernel variants that are missing in the cache."""
    parser = argparse.ArgumentParser(
        prog="python -m renderer.cuda", description=f"Builds the kernels for NVIDIA cards, without a card ({NOT_YET_TRIED})."
    )
    parser.add_argument("variants", nargs="*", metavar="VARIANT", help=f"of {', '.join(KERNEL_VARIANTS)}; by default all")
    parser.add_argument("--spectral", action="store_true", help=f"those for `spectral: on`, which has no kernel {_PLAIN}")
    options = parser.parse_args()
    known = [name for name in KERNEL_VARIANTS if name != _PLAIN or not options.spectral]
    wanted = options.variants or known
    if unknown := [name for name in wanted if name not in known]:
        parser.error(f"there is no kernel {', '.join(unknown)}; known are {', '.join(known)}")
    for name in wanted:
        variant = f"{name}{SPECTRAL_SUFFIX if options.spectral else ''}"
        begin = time.perf_counter()
        size = len(ptx_of(variant))
        print(printable(f"{variant}: {size / 1e6:.1f} MB, {time.perf_counter() - begin:.1f} s, {path_of(variant)}"), flush=True)


if __name__ == "__main__":
    main()
