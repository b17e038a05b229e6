"""`python -m renderer.cuda`: builds the PTX of kernel variants into the cache, without a GPU; prints each file's path.

The kernels for spectral pictures, guided paths and caustics are built only with `--spectral`, `--guided` or `--caustics`, and all
that settings can add to a variant with `--every`; otherwise at their first use.
"""

from __future__ import annotations

import argparse
import time

from renderer.arrays.scene_features import KERNEL_VARIANTS
from renderer.cuda.artefacts import path_of, ptx_of
from renderer.cuda.cards import NOT_YET_TRIED
from renderer.printable import printable
from renderer.variant_names import CAUSTICS_SUFFIX, GUIDED_SUFFIX, SPECTRAL_SUFFIX, base_variant, kernel_names

__all__ = ["main"]

_PLAIN, *_ = KERNEL_VARIANTS


def main() -> None:
    """Builds the PTX of the kernel variants that are missing in the cache."""
    parser = argparse.ArgumentParser(
        prog="python -m renderer.cuda", description=f"Builds the kernels for NVIDIA cards, without a card ({NOT_YET_TRIED})."
    )
    parser.add_argument("variants", nargs="*", metavar="VARIANT", help=f"of {', '.join(KERNEL_VARIANTS)}; by default all")
    more = parser.add_mutually_exclusive_group()
    for option, suffix, said in (
        ("--spectral", SPECTRAL_SUFFIX, f"`spectral: on`, which has no kernel {_PLAIN}"),
        ("--guided", GUIDED_SUFFIX, "`guiding: on` and `auto`"),
        ("--caustics", CAUSTICS_SUFFIX, f"`caustics: on`, which has no kernel {_PLAIN}"),
    ):
        more.add_argument(option, dest="suffix", action="store_const", const=suffix, default="", help=f"those for {said}")
    more.add_argument("--every", action="store_true", help="those for all combinations of settings")
    options = parser.parse_args()
    names = kernel_names()
    known = [name for name in KERNEL_VARIANTS if f"{name}{options.suffix}" in names]
    wanted = options.variants or known
    if unknown := [name for name in wanted if name not in known]:
        parser.error(f"there is no kernel {', '.join(unknown)}; known are {', '.join(known)}")
    every = [name for name in names if base_variant(name) in wanted]
    for variant in every if options.every else [f"{name}{options.suffix}" for name in wanted]:
        begin = time.perf_counter()
        size = len(ptx_of(variant))
        print(printable(f"{variant}: {size / 1e6:.1f} MB, {time.perf_counter() - begin:.1f} s, {path_of(variant)}"), flush=True)


if __name__ == "__main__":
    main()
