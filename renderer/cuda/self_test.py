"""The self-test of graphics cards: films of built-in scenes by a card and by the CPU, compared integer by integer.

`python -m renderer.cuda.self_test [--card NUMBER] [KERNEL ...]` runs it and prints the results. Programs call `run_self_test` of
verdicts.py, which also keeps the results.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence

from renderer.cuda.cards import described, find_cards
from renderer.cuda.driver import LIBRARY, Card, DriverError
from renderer.cuda.render import CardError, CardRenderer
from renderer.cuda.self_test_scenes import SPP, scenes_for, settings_for
from renderer.cuda.verdicts import START_KERNELS, Verdict, run_self_test
from renderer.printable import printable
from renderer.render import render_batch
from renderer.sentences import Sentence, to_text
from renderer.settings import Tile
from renderer.variant_names import base_variant

__all__ = ["judge", "main"]


def judge(card: Card, kernel: str, library: str = LIBRARY) -> Verdict:
    """Renders the scenes of a kernel with the CPU and with a graphics card, and compares the films. library: the driver's."""
    variant = base_variant(kernel)
    pictures = [(scene, scene.compiled(), settings_for(kernel, scene)) for scene in scenes_for(kernel)]
    whole = [Tile(0, 0, settings.width, settings.height) for _, _, settings in pictures]
    films = [
        render_batch(scene, settings, tile, 0, SPP, variant=variant).sums
        for (_, scene, settings), tile in zip(pictures, whole, strict=True)
    ]
    try:
        renderer = CardRenderer(card, library)
        renderer.load(kernel)
        for (about, scene, settings), tile, film in zip(pictures, whole, films, strict=True):
            wrong = int((render_batch(scene, settings, tile, 0, SPP, renderer, variant=variant).sums != film).any(0).sum())
            if wrong:
                return Verdict(_other_bits(kernel, about.name, wrong, tile), is_lasting=True)
        renderer.close()
    except (CardError, DriverError) as error:
        failed = Sentence("card-test-error", "the self-test of kernel {kernel} failed: {error}", kernel=kernel, error=error)
        return Verdict(failed, is_lasting=False)
    return Verdict("", is_lasting=True)


def _other_bits(kernel: str, scene: str, wrong: int, tile: Tile) -> str:
    return Sentence(
        "card-other-bits",
        "it computed other bits in the self-test: {wrong} of {pixels} pixels of the scene {scene} with kernel {kernel}",
        wrong=wrong,
        pixels=tile.w * tile.h,
        scene=scene,
        kernel=kernel,
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Tests kernels on the cards of this machine; returns 1 if one fails, and 2 if there is no card."""
    parser = argparse.ArgumentParser(
        prog="python -m renderer.cuda.self_test", description="Compares films of graphics cards with those of the processor."
    )
    parser.add_argument("kernels", nargs="*", metavar="KERNEL", help=f"by default {' '.join(START_KERNELS)}")
    parser.add_argument("--card", type=int, help="the card's number; by default all cards are tested")
    parser.add_argument("--json", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    found = find_cards()
    cards = [card for card in found.usable if options.card in (None, card.number)]
    if not cards:
        print(printable(" ".join(found.refused) or f"There is no usable card {options.card}."), file=sys.stderr)
        return 2
    failures = 0
    for card in cards:
        for kernel in options.kernels or START_KERNELS:
            if options.json:
                reason, is_lasting = judge(card, kernel)
                print(json.dumps([to_text(reason), is_lasting]), flush=True)
                continue
            verdict = run_self_test(card, kernel)
            failures += bool(verdict.reason)
            result = verdict.reason or f"films equal the processor's ({', '.join(each.name for each in scenes_for(kernel))})"
            print(printable(f"card {described(card)}: {kernel}: {result}"), flush=True)
    return int(failures > 0)


if __name__ == "__main__":
    sys.exit(main())
