"""`python -m renderer.self_test [--card NUMBER] [KERNEL ...]`: tests graphics cards, prints the results and keeps them."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence

from renderer import jit
from renderer.cuda.artefacts import kernel_name as card_kernel_name
from renderer.cuda.artefacts import ptx_of
from renderer.cuda.cards import described, find_cards, find_cards_before_fork
from renderer.cuda.verdicts import START_KERNELS, failed_kernels, run_self_test
from renderer.printable import printable
from renderer.render import kernel_name, warm_up
from renderer.self_test.compare import judge
from renderer.self_test.scenes import scenes_for
from renderer.sentences import to_text
from renderer.variant_names import base_variant, example_of

__all__ = ["main"]


def main(arguments: Sequence[str] | None = None) -> int:
    """Tests kernels on the cards of this machine; returns 1 if one fails, and 2 if there is no card."""
    parser = argparse.ArgumentParser(
        prog="python -m renderer.self_test", description="Compares films of graphics cards with those of the processor."
    )
    parser.add_argument(
        "kernels", nargs="*", metavar="KERNEL", help=f"by default {' '.join(START_KERNELS)} and those that failed"
    )
    parser.add_argument("--card", type=int, help="the card's number; by default all cards are tested")
    parser.add_argument("--json", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    found = find_cards() if options.json else find_cards_before_fork()  # building a kernel may fork
    cards = [card for card in found.usable if options.card in (None, card.number)]
    if not cards:
        print(printable(" ".join(found.refused) or f"There is no usable card {options.card}."), file=sys.stderr)
        return 2
    failures = 0
    for card in cards:
        for kernel in options.kernels or dict.fromkeys((*START_KERNELS, *failed_kernels(card))):
            if options.json:
                reason, is_lasting = judge(card, kernel)
                print(json.dumps([to_text(reason), is_lasting]), flush=True)
                continue
            _build(kernel)
            verdict = run_self_test(card, kernel)
            failures += bool(verdict.reason)
            result = verdict.reason or f"films equal the processor's ({', '.join(each.name for each in scenes_for(kernel))})"
            print(printable(f"card {described(card)}: {kernel}: {result}"), flush=True)
    return int(failures > 0)


def _build(kernel: str) -> None:
    """Builds a kernel for cards and for the processor if it is missing, as the test's time limit would include that."""
    settings, variant = example_of(kernel)[1], base_variant(kernel)
    if not (jit.is_cached(card_kernel_name(kernel)) and jit.is_cached(kernel_name(settings, variant))):
        print(printable(f"building kernel {kernel} for cards and for the processor, some minutes of a core"), file=sys.stderr)
    ptx_of(kernel)
    warm_up(settings, variant)


if __name__ == "__main__":
    sys.exit(main())
