"""Graphics card of a slot: the last slots of a worker use one card each, the others render with the CPU."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable

from protocol.contract import RenderBatch
from renderer import jit
from renderer.cuda.artefacts import kernel_name
from renderer.cuda.driver import Card, DriverError
from renderer.cuda.render import CardError, CardMemoryError, CardRenderer
from renderer.film import BatchSums
from renderer.render import is_for_cards, render_batch
from renderer.scene.compiled import CompiledScene
from worker.exchange.kernels import fetch_kernel, upload_kernel_in_background
from worker.process.context import WorkerContext
from worker.process.slot_number import slot

__all__ = ["card_of", "render_with_card"]

log = logging.getLogger("worker")

_cards: dict[int, CardRenderer | None] = {}  # of this process's slot; None after a failure
_too_large: set[str] = set()  # compiled scenes that do not fit its memory


def card_of(worker: WorkerContext, number: int) -> Card | None:
    """Returns the card of a slot; None for a slot that renders with the CPU."""
    place = number - (worker.slots - len(worker.cards))
    return worker.cards[place] if 0 <= place < len(worker.cards) else None


def render_with_card(
    worker: WorkerContext, batch: RenderBatch, scene: CompiledScene, variant: str, compiling: Callable[[bool], None]
) -> tuple[BatchSums, float] | None:
    """Renders a batch with this slot's card. Returns (its sums, seconds).

    None if the slot has no card, or if the card cannot render it, which is logged; then the CPU renders it.

    compiling: called with True before the kernel is made ready, and with False afterwards.
    """
    card = card_of(worker, slot())
    if card is None or batch.compiled in _too_large or not is_for_cards(batch.settings):
        return None
    try:
        if card.number not in _cards:
            _cards[card.number] = CardRenderer(card)
        renderer = _cards[card.number]
        if renderer is None:
            return None
        if not renderer.has(variant):
            compiling(True)
            _load(worker, renderer, variant)
            compiling(False)
        begun = time.perf_counter()
        sums = render_batch(scene, batch.settings, batch.tile, batch.first, batch.count, renderer)
        return sums, time.perf_counter() - begun
    except CardMemoryError as error:
        _too_large.add(batch.compiled)
        log.warning("%s; the processor renders it", error)
    except (CardError, DriverError) as error:  # the driver refuses all further work of this process
        _cards[card.number] = None
        log.warning("%s; from now on the processor renders in its place", error)
    return None


def _load(worker: WorkerContext, renderer: CardRenderer, variant: str) -> None:
    """Loads a kernel: downloads it from the farm, or builds and uploads it."""
    is_fetched = False

    def fetch(name: str) -> None:
        nonlocal is_fetched
        is_fetched, sentence = fetch_kernel(worker.link, jit.cache_folder(), name)
        log.info(sentence)

    renderer.load(variant, fetch)
    if not is_fetched:
        upload_kernel_in_background(worker.link, jit.cache_folder(), kernel_name(variant))
