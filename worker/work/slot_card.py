"""Rendering of batches with a slot's graphics card (protocol/card.py).

Adjacent tiles are rendered by one kernel launch, as a GPU needs many samples at once. While it renders, the sums of the previous
tiles are packed and sent.
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import NamedTuple, TypeVar

import numpy as np

from protocol.card import CardBatches
from protocol.contract import RenderBatch, Result
from renderer import jit
from renderer.cuda.artefacts import kernel_name
from renderer.cuda.driver import Card, DriverError
from renderer.cuda.render import CardError, CardMemoryError, CardRenderer
from renderer.errors import RayfarmError
from renderer.film import SAMPLES, BatchSums
from renderer.kernel.accumulate import samples_guide
from renderer.render import is_for_cards, render_batch, settings_as_rendered, variant_for, warm_up_caustics
from renderer.scene.compiled import CompiledScene
from renderer.sentences import Sentence
from renderer.settings import RenderSettings, Tile
from renderer.variant_names import variant_suffix
from worker.exchange.errors import TemporaryError, WorkerError
from worker.exchange.kernels import fetch_kernel, upload_kernel_in_background
from worker.exchange.ready import pilot_readiness
from worker.exchange.retry import retry_temporary
from worker.process.context import WorkerContext
from worker.process.slot_number import slot
from worker.work.card_self_test import check_kernel
from worker.work.open_scenes import mapped_scene
from worker.work.path_guides import use_stored_guide
from worker.work.render import PATIENCE_S, rendered_outcome, returned_event

__all__ = [
    "MAX_PACKED_BEHIND",
    "Block",
    "Render",
    "ReturnedError",
    "UnusableError",
    "blocks_of",
    "render_blocks",
    "render_on_card",
    "return_to_cpus",
]

log = logging.getLogger("worker")

BLOCK_SAMPLES = 1 << 25  # most samples of a launch's block, so that sums come back several times a second
MAX_PACKED_BEHIND = 2  # blocks whose sums wait to be packed and sent, which bounds the memory

_cards: dict[int, CardRenderer | None] = {}  # of this process's slot; None after a failure
_failed_tests: dict[int, str] = {}  # why a card failed the self-test: a sentence by the card's number
_too_large: set[str] = set()  # compiled scenes that do not fit its memory

T = TypeVar("T")
Render = Callable[[CompiledScene, RenderSettings, Tile, int, int, CardRenderer], T]  # as `render_batch` with a card
Show = Callable[["Block", bool], None]  # called with the block that is rendered next, and whether a kernel is made ready


class Block(NamedTuple):
    """Batches with the same sample numbers, of adjacent tiles that fill a rectangle."""

    tile: Tile  # the rectangle
    batches: list[RenderBatch]

    @property
    def samples(self) -> int:
        """Number of samples, over all pixels."""
        return self.tile.w * self.tile.h * self.batches[0].count


class UnusableError(Exception):
    """Raised if this slot's card cannot render the batches. The argument is the reason, a sentence."""


class ReturnedError(Exception):
    """Raised to return batches that this worker cannot render at present. The argument is the reason, a sentence."""


def blocks_of(batches: Sequence[RenderBatch], most: int = BLOCK_SAMPLES) -> list[Block]:
    """Groups batches of adjacent tiles into rectangular blocks: first within a row of tiles, then across rows.

    Only batches of the same frame and the same samples are grouped, and none whose samples are recorded (Cryptomatte, deep
    pixels): their counts are by tile. most: maximum number of samples of a block, over all pixels.
    """
    if any(batch.settings.cryptomatte or batch.settings.deep for batch in batches):
        return [Block(batch.tile, [batch]) for batch in batches]
    groups: dict[object, list[RenderBatch]] = {}
    for batch in batches:
        groups.setdefault((batch.job, batch.frame, batch.compiled, batch.first, batch.count), []).append(batch)
    found: list[Block] = []
    for group in groups.values():
        single = [Block(batch.tile, [batch]) for batch in group]
        rows = _join_adjacent_blocks(
            sorted(single, key=lambda block: (block.tile.y, block.tile.h, block.tile.x)), _union_with_right, most
        )
        found += _join_adjacent_blocks(
            sorted(rows, key=lambda block: (block.tile.x, block.tile.w, block.tile.y)), _union_with_lower, most
        )
    return found


def _join_adjacent_blocks(blocks: list[Block], join: Callable[[Tile, Tile], Tile | None], most: int) -> list[Block]:
    found: list[Block] = []
    for block in blocks:
        last = found[-1] if found else None
        tile = None if last is None or last.samples + block.samples > most else join(last.tile, block.tile)
        if last is None or tile is None:
            found.append(block)
        else:
            found[-1] = Block(tile, [*last.batches, *block.batches])
    return found


def _union_with_right(a: Tile, b: Tile) -> Tile | None:
    """Returns the union of tile `a` and tile `b` if `b` is its right neighbour of equal height, else None."""
    return Tile(a.x, a.y, a.w + b.w, a.h) if (a.y, a.h, a.x + a.w) == (b.y, b.h, b.x) else None


def _union_with_lower(a: Tile, b: Tile) -> Tile | None:
    return Tile(a.x, a.y, a.w, a.h + b.h) if (a.x, a.w, a.y + a.h) == (b.x, b.w, b.y) else None


def render_on_card(worker: WorkerContext, work: CardBatches, show: Show) -> float:
    """Renders the batches with this slot's graphics card, and sends their sums. Returns the samples per second.

    Returns 0 if none was rendered. Sends batches that the card cannot render back to the service, which dispatches them to CPU
    slots. show: called before each block with the block and whether its kernel is being compiled.
    """
    left = {batch.batch: batch for batch in work.batches}
    samples, seconds = 0, 0.0
    with ThreadPoolExecutor(1, thread_name_prefix="sums") as sender:
        sending: list[Future[None]] = []
        try:
            for block, sums, took in render_blocks(worker, work.batches, show, render_batch):
                samples, seconds = samples + block.samples, seconds + took
                while len(sending) >= MAX_PACKED_BEHIND:
                    sending.pop(0).result()
                sending.append(sender.submit(_send, worker, block, sums, took))
                for batch in block.batches:
                    del left[batch.batch]
        except UnusableError as error:
            return_to_cpus(worker, left.values(), error.args[0])
        except ReturnedError as error:
            for batch in left.values():
                worker.results.send(returned_event(worker, batch, error.args[0]))
        for each in sending:
            each.result()
    return samples / seconds if seconds else 0.0


def return_to_cpus(worker: WorkerContext, batches: Iterable[RenderBatch], reason: str) -> None:
    """Sends batches back to the service, which dispatches them to CPU slots. reason: a sentence."""
    for batch in batches:
        event = returned_event(worker, batch, reason)
        worker.results.send(Result({**event.event, "for_cpu": True}))


def render_blocks(
    worker: WorkerContext, batches: Sequence[RenderBatch], show: Show, render: Render[T]
) -> Iterator[tuple[Block, T, float]]:
    """Renders batches of one frame with this slot's graphics card. Yields each block, what `render` returned, and the seconds.

    Raises UnusableError or ReturnedError.
    """
    card = worker.cards[slot()]
    try:
        for block in blocks_of(batches):
            batch = block.batches[0]
            show(block, False)
            renderer, scene = _prepare_renderer(worker, card, batch, partial(show, block))
            begun = time.perf_counter()
            rendered = render(scene, batch.settings, block.tile, batch.first, batch.count, renderer)
            yield block, rendered, time.perf_counter() - begun
    except CardMemoryError as error:
        _too_large.add(batch.compiled)
        log.warning("%s; the processor renders it", error)
        raise UnusableError(_scene_too_large(card)) from error
    except (CardError, DriverError) as error:  # the driver refuses all further work of this process
        _cards[card.number] = None
        log.warning("%s; from now on the processor renders in its place", error)
        raise UnusableError(_card_failed_sentence(card)) from error
    except (RayfarmError, WorkerError, MemoryError) as error:  # what the CPU cannot render either fails there
        sentence = Sentence("worker-returned-batch", "{worker} returned a batch: {error}", worker=worker.name, error=error)
        raise (ReturnedError if isinstance(error, TemporaryError) else UnusableError)(sentence) from error


def _prepare_renderer(
    worker: WorkerContext, card: Card, batch: RenderBatch, compiling: Callable[[bool], None]
) -> tuple[CardRenderer, CompiledScene]:
    """Returns the renderer of a graphics card, with the kernel for a batch loaded, and the batch's scene.

    compiling: called with True before a kernel is loaded, and with False afterwards. Raises UnusableError, and the errors of
    opening the scene and loading the kernel.
    """
    if not is_for_cards(batch.settings):
        raise UnusableError(
            Sentence("card-lacks-settings", "A graphics card does not render with these settings: the processor does.")
        )
    if batch.compiled in _too_large:
        raise UnusableError(_scene_too_large(card))
    if card.number in _cards and _cards[card.number] is None:
        raise UnusableError(_failed_tests.get(card.number) or _card_failed_sentence(card))
    scene = retry_temporary(lambda: mapped_scene(worker, batch.compiled), PATIENCE_S)
    variant = variant_for(batch.settings, scene)
    if samples_guide(batch.settings):
        use_stored_guide(worker, scene, batch.settings, batch.guide)
    settings = settings_as_rendered(batch.settings, scene, pilot_readiness(worker.link, compiling))
    kernel = f"{variant}{variant_suffix(settings)}"
    renderer = _cards.get(card.number)
    if renderer is None or not renderer.has_kernel(kernel):
        compiling(True)
        if reason := check_kernel(worker.link, card, kernel, partial(_release, card)):
            _cards[card.number], _failed_tests[card.number] = None, reason
            log.warning("%s", reason)
            raise UnusableError(reason)
        renderer = _cards.get(card.number) or CardRenderer(card)
        _cards[card.number] = renderer
        _load(worker, renderer, kernel)
        warm_up_caustics(settings, variant)
        compiling(False)
    return renderer, scene


def _release(card: Card) -> None:
    """Frees what this process has on a graphics card."""
    if (renderer := _cards.pop(card.number, None)) is not None:
        renderer.close()


def _scene_too_large(card: Card) -> str:
    return Sentence(
        "card-scene-too-large",
        "The scene does not fit the memory of card {number} ({name}, {memory} GiB): the processor renders it.",
        number=card.number,
        name=card.name,
        memory=round(card.memory / 2**30),
    )


def _card_failed_sentence(card: Card) -> str:
    return Sentence(
        "card-failed",
        "Card {number} ({name}) has failed: the processor renders in its place. The worker's log has the driver's error; start "
        "the worker again to use the card.",
        number=card.number,
        name=card.name,
    )


def _send(worker: WorkerContext, block: Block, sums: BatchSums, seconds: float) -> None:
    """Sends the sums of each batch of a block."""
    for batch in block.batches:
        x, y, w, h = batch.tile
        left, top = x - block.tile.x, y - block.tile.y
        part = np.ascontiguousarray(sums.sums[:, top : top + h, left : left + w])
        bad = [each for each in sums.bad if x <= each.x < x + w and y <= each.y < y + h]
        count = w * h * batch.count - int(part[SAMPLES].sum())
        share = w * h / (block.tile.w * block.tile.h)
        own = BatchSums(part, bad, count, sums.hits, sums.deep)  # blocks with these have one batch
        worker.results.send(rendered_outcome(worker, batch, own, seconds * share).result())


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
