"""The self-test of a graphics card before a worker uses it, or one of its kernels (renderer/self_test)."""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence

from renderer import jit
from renderer.cuda.artefacts import ptx_of
from renderer.cuda.cards import unused_card
from renderer.cuda.driver import Card
from renderer.cuda.verdicts import START_KERNELS, discard_passing_failures, failure_of, kept_verdict, run_self_test
from renderer.variant_names import base_variant, example_of
from worker.exchange.kernels import fetch_kernel
from worker.exchange.link import Link
from worker.exchange.ready import fetch_or_compile

__all__ = ["check_cards", "check_kernel"]

log = logging.getLogger("worker")


def check_cards(link: Link, cards: Sequence[Card]) -> tuple[list[Card], list[str]]:
    """Tests the graphics cards with START_KERNELS, as far as no verdict that lasts is in the cache.

    Failures of any kernel that may have passed are discarded; a card with one that lasts is not used. Returns the cards that
    passed, and a sentence about each of the others.
    """
    passed, failures = [], []
    for card in cards:
        discard_passing_failures(card)
        reasons = (check_kernel(link, card, kernel) for kernel in START_KERNELS)
        if reason := failure_of(card) or next(filter(None, reasons), ""):
            log.warning("%s", reason)
            failures.append(reason)
        else:
            passed.append(card)
    return passed, failures


def check_kernel(link: Link, card: Card, kernel: str, release: Callable[[], None] = lambda: None) -> str:
    """Tests a kernel on a graphics card unless its verdict is in the cache; fetches or builds the kernel if necessary.

    Returns a sentence on why the card must not be used; "" if it passed. release: called before the test; must release the card,
    which may admit one process only.
    """

    def fetch(name: str) -> None:
        _, sentence = fetch_kernel(link, jit.cache_folder(), name)
        log.info(sentence)

    verdict = kept_verdict(card, kernel, ptx_of(kernel, fetch))
    if verdict is None:
        fetch_or_compile(link, example_of(kernel)[1], base_variant(kernel))
        log.info("card %d (%s): comparing films of kernel %s with the processor's", card.number, card.name, kernel)
        release()
        verdict = run_self_test(card, kernel)
    return unused_card(card, verdict.reason) if verdict.reason else ""
