"""`python -m renderer.precompile`: compiles the kernels for images into the cache, for installations and container images.

Variants are compiled in parallel, one process each, as cores and memory allow; with --cards also for graphics cards. If a FOLDER
is given, only the files that the kernels need (each kernel's `.done` lists them) are copied to FOLDER/kernels: an eighth of the
files that compiling creates.
"""

from __future__ import annotations

import argparse
import gc
import subprocess
import sys
import time
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

from renderer import jit
from renderer.confine.limits import available_memory
from renderer.cuda.artefacts import kernel_name as card_kernel_name
from renderer.cuda.artefacts import ptx_of
from renderer.parallel_compile import Helpers
from renderer.preparation_kernels import prepare
from renderer.render import KERNEL_VARIANTS, kernel_name, warm_up
from renderer.shipped_kernels import copy_finished_kernels, copy_shipped_kernels
from renderer.threads import cores

__all__ = ["main"]

MEMORY = 1 << 30  # memory that a process needs to compile a variant
PREPARING = "preparing"  # the job of the kernels that prepare scenes
FOR_CARD = "card:"  # begins the job of a variant's kernels for graphics cards


def _compile(job: str, prepares: bool) -> None:
    """Compiles one job, a kernel variant, for processors or cards, or the kernels that prepare scenes; in a separate process.

    prepares: also lists the kernels that prepare scenes among the files of the variant's kernel.
    """
    gc.disable()  # collections take a fifth of the time and find little; this process ends afterwards
    if job == PREPARING:
        prepare()
    elif job.startswith(FOR_CARD):
        ptx_of(job.removeprefix(FOR_CARD))
    else:
        warm_up(variant=job, helpers=Helpers(job, wanted=False), prepares=prepares)


def _compile_in_process(job: str, *options: str) -> None:
    subprocess.run([sys.executable, "-m", "renderer.precompile", "--job", job, *options], check=True)


def _jobs(variants: list[str], for_cards: list[str]) -> list[str]:
    """Returns the compile jobs: the variants, longest compile first, and the kernels that prepare scenes."""
    first = [*(f"{FOR_CARD}{name}" for name in _longest_first(for_cards)), *_longest_first(variants)]
    return [*first, PREPARING] if variants else first


def _longest_first(variants: list[str]) -> list[str]:
    return sorted(variants, key=lambda name: sum(map(bool, KERNEL_VARIANTS[name])), reverse=True)


def _max_parallel_jobs(count: int) -> int:
    return max(1, min(count, cores(), available_memory() // MEMORY))


def _compile_all(jobs: list[str], begin: float) -> None:
    """Compiles the jobs in parallel, and prints a line after each: how many are ready, and the time taken.

    begin: the start time, from time.perf_counter().
    """
    count = _max_parallel_jobs(len(jobs))
    print(f"compiling {len(jobs)} kernels, {count} at a time ({', '.join(jobs)})", flush=True)
    with ThreadPoolExecutor(count) as pool:
        waiting = {pool.submit(_compile_in_process, job): job for job in jobs}
        try:
            for ready, each in enumerate(as_completed(waiting), 1):
                each.result()
                print(f"{ready} of {len(jobs)} after {time.perf_counter() - begin:.0f} s: {waiting[each]}", flush=True)
        except BaseException:  # including Ctrl-C: start no further job
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _variants(text: str) -> list[str]:
    names = list(KERNEL_VARIANTS) if text == "all" else [name for name in text.split(",") if name]
    if unknown := [name for name in names if name not in KERNEL_VARIANTS]:
        raise argparse.ArgumentTypeError(f"there is no kernel {', '.join(unknown)}; known are {', '.join(KERNEL_VARIANTS)}")
    return names


def _missing(variants: list[str], for_cards: list[str]) -> tuple[list[str], list[str]]:
    """Returns those of the variants for processors and of those for cards that the cache lacks."""
    return (
        [name for name in variants if not jit.is_cached(kernel_name(variant=name))],
        [name for name in for_cards if not jit.is_cached(card_kernel_name(name))],
    )


def main(arguments: Iterable[str] | None = None) -> None:
    """Compiles the kernels, loads each variant once more to complete its list of files, then copies the files.

    Raises CalledProcessError if a compiling process fails.
    """
    parser = argparse.ArgumentParser(prog="python -m renderer.precompile", description="Compiles the kernels for pictures.")
    parser.add_argument("folder", nargs="?", type=Path, help="gets kernels/HASH")
    parser.add_argument(
        "--kernels",
        type=_variants,
        default=list(KERNEL_VARIANTS),
        metavar="NAME,...",
        help=f"of {', '.join(KERNEL_VARIANTS)}; by default all",
    )
    parser.add_argument(
        "--cards",
        type=_variants,
        default=[],
        metavar="NAME,...",
        help="the same kernels for NVIDIA cards, a minute of a core each: names, or all; by default none",
    )
    parser.add_argument("--if-avx512", action="store_true", help="do nothing on a processor without AVX-512")
    parser.add_argument("--job", help=argparse.SUPPRESS)
    parser.add_argument("--prepares", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.job:
        _compile(options.job, options.prepares)
        return
    if options.folder is not None:
        (options.folder / "kernels").mkdir(parents=True, exist_ok=True)
    if options.if_avx512 and not jit.HAS_AVX512:
        print("this processor has no AVX-512: kernels for it are compiled by the first worker that has it")
        return
    begin = time.perf_counter()
    if _missing(options.kernels, options.cards) != ([], []):
        copy_shipped_kernels(jit.cache_folder())
    if jobs := _jobs(*_missing(options.kernels, options.cards)):
        _compile_all(jobs, begin)
    for name in options.kernels:
        _compile_in_process(name, "--prepares")
    print(f"{jit.kind()}: kernels ready after {time.perf_counter() - begin:.0f} s")
    if options.folder is not None:
        copy_finished_kernels(jit.cache_folder(), options.folder / "kernels" / jit.cache_folder().name)


if __name__ == "__main__":
    main()
