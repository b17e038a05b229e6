"""Rendering of parts and drafts of live views with a slot's graphics card (protocol/view_parts.py).

Parts that the card cannot render, or cannot render soon, are declined at once, and the service sends them to CPU slots.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from protocol.contract import RenderBatch
from protocol.view_parts import ViewParts
from renderer.film import BatchSums
from renderer.image.draft import encode_draft
from renderer.render import render_batch, render_draft
from worker.process.context import WorkerContext
from worker.work.slot_card import MAX_PACKED_BEHIND, Block, Render, ReturnedError, UnusableError, render_blocks
from worker.work.viewport import ViewAnswers, pack_view_sums, view_failed

__all__ = ["render_view_on_card"]

T = TypeVar("T")

MAX_READY = 256  # scenes

log = logging.getLogger(__name__)

_ready: dict[str, None] = {}  # compiled scenes that this process's slot has rendered with its card, latest last


def render_view_on_card(worker: WorkerContext, work: ViewParts, report_compiling: Callable[[bool], None]) -> float:
    """Renders parts of a view with this slot's graphics card. Returns the samples per second; 0 as for `render_view`.

    Adjacent parts are rendered by one launch. If the card has not rendered the scene before, or its kernel is not loaded, the
    parts are declined; then the first of them are rendered nevertheless, which loads both, and their sums are discarded.

    report_compiling: called with True before a kernel is loaded, and with False afterwards.
    """
    if work.draft is None:
        return _render_and_send(worker, work, report_compiling, render_batch, _send_sums)
    render = partial(render_draft, exposure=work.draft, is_smooth=work.is_smooth)
    return _render_and_send(worker, work, report_compiling, render, _send_draft)


def _render_and_send(
    worker: WorkerContext,
    work: ViewParts,
    report_compiling: Callable[[bool], None],
    render: Render[T],
    send: Callable[[ViewAnswers, ViewParts, Block, T, float], None],
) -> float:
    """Renders and answers as `render_view_on_card` states. render: as for `render_blocks`. send: sends its result for a block.

    A draft is the only answer to its message: others would take as long as everything besides the draft's compression.
    """
    answering = ViewAnswers(worker, work)
    if not answering.is_wanted():
        return 0.0
    if work.draft is None:
        answering.send("begun")
    is_loading = work.compiled not in _ready
    if is_loading:
        answering.send("declined", is_loading=True)

    def show(_: Block, is_compiling: bool) -> None:
        nonlocal is_loading
        if is_compiling and not is_loading:
            is_loading = True
            answering.send("declined", is_loading=True)
        report_compiling(is_compiling)

    batches = [
        RenderBatch(str(part.number), work.watch, 0, work.compiled, part.tile, part.first, part.count, work.settings)
        for part in work.parts
    ]
    samples, seconds = 0, 0.0
    with ThreadPoolExecutor(1, thread_name_prefix="sums") as sender:
        sending: list[Future[None]] = []
        try:
            for block, rendered, took in render_blocks(worker, batches, show, render):
                _set_ready(work.compiled)
                if is_loading:
                    break
                samples, seconds = samples + block.samples, seconds + took
                if work.draft is not None:
                    send(answering, work, block, rendered, took)
                    continue
                while len(sending) >= MAX_PACKED_BEHIND:
                    sending.pop(0).result()
                sending.append(sender.submit(send, answering, work, block, rendered, took))
                if not answering.is_wanted():
                    break
        except (UnusableError, ReturnedError) as error:
            _wait_for(sending)
            answering.send("declined", error=error.args[0])
            return 0.0
        except Exception as error:  # any error fails this message only, not the worker
            log.exception("a view failed on a graphics card")
            _wait_for(sending)
            answering.send("declined", error=view_failed(worker, error))
            return 0.0
        _wait_for(sending)
    if work.draft is None or is_loading:
        answering.send("over")
    return samples / seconds if seconds and not work.is_first_hits else 0.0


def _wait_for(sending: list[Future[None]]) -> None:
    for each in sending:
        each.result()


def _set_ready(compiled: str) -> None:
    _ready.pop(compiled, None)
    _ready[compiled] = None
    if len(_ready) > MAX_READY:
        del _ready[next(iter(_ready))]


def _send_sums(answering: ViewAnswers, work: ViewParts, block: Block, sums: BatchSums, seconds: float) -> None:
    """Sends the sums of each part of a block. seconds: rendering time of the block."""
    area = block.tile.w * block.tile.h
    for batch in block.batches:
        x, y, w, h = batch.tile
        left, top = x - block.tile.x, y - block.tile.y
        packed = pack_view_sums(sums.sums[:, top : top + h, left : left + w], work)
        answering.send("part", packed, number=int(batch.batch), seconds=seconds * w * h / area)


def _send_draft(answering: ViewAnswers, work: ViewParts, block: Block, words: npt.NDArray[np.uint32], seconds: float) -> None:
    """Sends the draft that answers a message, as a JPEG. words: of the draft. seconds: its rendering time."""
    answering.send("draft", encode_draft(words), seconds=seconds)
