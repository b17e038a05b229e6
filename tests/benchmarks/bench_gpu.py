"""NVIDIA graphics cards: builds their kernels, compares their films with the CPU's bit by bit, and measures both against Mitsuba.

    python3 farm.py bench gpu [--quick] [--scenes "Cornell box,glass"] [--no-mitsuba] [--library PATH]

Without a graphics card it builds the kernels and prints why no card is used. Mitsuba's variant cuda_ad_rgb runs in a separate
process, if it is installed. Times are the best of several tries after compilation, with splitting 1, so that all trace equally
many paths. Hardware counters: ncu --set full --launch-count 1 python -m tests.benchmarks.bench_gpu --once "Cornell box"
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from renderer.arrays.scene_features import KERNEL_VARIANTS
from renderer.cuda.artefacts import ptx_of
from renderer.cuda.cards import NOT_YET_TRIED, described, find_cards
from renderer.cuda.driver import LIBRARY
from renderer.cuda.render import CardRenderer
from renderer.film import digest
from renderer.render import render_frame, variant_for
from renderer.scene.compile import compile_scene
from renderer.settings import RenderSettings
from renderer.threads import cores
from tests.benchmarks.peers.scenes import CASES, Case
from tests.benchmarks.peers.sizes import FULL, QUICK, Sizes
from tests.peers.mitsuba_scene import mitsuba_dict

TRIES = 3
COMPARED, COMPARED_SPP = 256, 16  # width in pixels and samples of the films that are compared
TIMED = ((512, 512, 64), (512, 512, 256), (1920, 1080, 64))
CPU_SPP = 16
QUICK_TIMED = ((64, 64, 4),)


def main() -> int:
    options = _options()
    sizes = QUICK if options.quick else FULL
    if options.mitsuba:
        return _mitsuba(options, sizes)
    for variant in KERNEL_VARIANTS if options.scenes is None else ():
        begin = time.perf_counter()
        print(f"PTX of {variant}: {len(ptx_of(variant)) / 1e6:.1f} MB, {time.perf_counter() - begin:.1f} s", flush=True)
    cards = find_cards(options.library)
    for reason in cards.refused:
        print(reason)
    if not cards.usable:
        print("Nothing is rendered; `rayfarm doctor` checks the driver.")
        return 0
    card = CardRenderer(cards.usable[0], options.library)
    print(f"card {described(card.card)} ({NOT_YET_TRIED}), beside {cores()} cores")
    wrong = 0
    for case in _cases(options, sizes):
        if options.once:
            _timed(case, card, *QUICK_TIMED[0])
            continue
        wrong += _compare(case, card, options.quick)
        _measure(case, card, options.quick)
    card.close()
    if not (options.no_mitsuba or options.once):
        command = [sys.executable, "-m", "tests.benchmarks.bench_gpu", "--mitsuba", *(["--quick"] if options.quick else [])]
        subprocess.run([*command, *(["--scenes", options.scenes] if options.scenes else [])], check=False)
    print(f"{wrong} films differ from the CPU's" if wrong else "all films have the CPU's bits")
    return 1 if wrong else 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="farm.py bench gpu", description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="small scenes and pictures, to see that every step works")
    parser.add_argument("--scenes", help="the beginnings of their names, with commas; by default all, and all variants are built")
    parser.add_argument("--library", default=LIBRARY, help="the driver's library")
    parser.add_argument("--no-mitsuba", action="store_true", help="leave out Mitsuba")
    parser.add_argument("--once", metavar="SCENE", help="one small render, for a profiler")
    parser.add_argument("--mitsuba", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    options.scenes = options.once or options.scenes
    return options


def _cases(options: argparse.Namespace, sizes: Sizes) -> list[Case]:
    wanted = options.scenes.split(",") if options.scenes else [""]
    return [make(sizes) for name, make in CASES.items() if any(name.startswith(each) for each in wanted)]


def _settings(case: Case, width: int, height: int) -> RenderSettings:
    return replace(case.settings(width, splitting=1), height=height)


def _compare(case: Case, card: CardRenderer, quick: bool) -> int:
    """Prints whether the graphics card's film equals the CPU's to the bit; returns 1 if not, otherwise 0."""
    pixels, spp = (32, 4) if quick else (COMPARED, COMPARED_SPP)
    scene, settings = compile_scene(case.description), case.settings(pixels)
    films = [render_frame(scene, settings, spp, card=each) for each in (card, None)]
    differ = int((films[0] != films[1]).any(0).sum())
    equal = "equal" if not differ else f"{differ} of {pixels * pixels} pixels differ"
    print(
        f"{case.name}, {variant_for(settings, scene)}: card {digest(films[0])[:12]}, CPU {digest(films[1])[:12]}: {equal}",
        flush=True,
    )
    return int(differ > 0)


def _measure(case: Case, card: CardRenderer, quick: bool) -> None:
    for width, height, spp in QUICK_TIMED if quick else TIMED:
        _timed(case, card, width, height, spp)
    width, height, spp = QUICK_TIMED[0] if quick else (512, 512, CPU_SPP)
    _timed(case, None, width, height, spp)


def _timed(case: Case, card: CardRenderer | None, width: int, height: int, spp: int) -> None:
    scene, settings = compile_scene(case.description), _settings(case, width, height)
    who = "CPU" if card is None else "card"
    _print_speed(who, case, width, height, spp, lambda _: render_frame(scene, settings, spp, card=card))


def _mitsuba(options: argparse.Namespace, sizes: Sizes) -> int:
    try:
        import mitsuba as mi

        mi.set_variant("cuda_ad_rgb")
        import drjit
    except ImportError as error:
        print(f"Mitsuba's cuda_ad_rgb is left out: {error}")
        return 0
    for case in _cases(options, sizes):
        for width, height, spp in QUICK_TIMED if options.quick else TIMED:
            with tempfile.TemporaryDirectory() as folder:
                made = mitsuba_dict(mi, case.twin or case.description, _settings(case, width, height), Path(folder))
                if case.theirs is not None:
                    case.theirs(mi, made)
                scene = mi.load_dict(made)

            def picture(seed: int, scene: Any = scene, spp: int = spp) -> None:
                drjit.eval(mi.render(scene, spp=spp, seed=seed))
                drjit.sync_thread()

            _print_speed("Mitsuba", case, width, height, spp, picture)
    return 0


def _print_speed(who: str, case: Case, width: int, height: int, spp: int, picture: Callable[[int], Any]) -> None:
    """Prints the speed of the renderer named `who` in millions of samples per second: the fastest run after a warm-up.

    picture: renders the case with a given seed.
    """
    seconds = []
    for seed in range(TRIES + 1):
        begin = time.perf_counter()
        picture(seed)
        seconds.append(time.perf_counter() - begin)
    speed = width * height * spp / min(seconds[1:]) / 1e6
    print(f"{case.name}, {width}x{height}x{spp}, {who}: {speed:.1f} M samples/s; the first took {seconds[0]:.2f} s", flush=True)


if __name__ == "__main__":
    sys.exit(main())
