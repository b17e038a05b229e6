"""Tests of the order in which a worker reads its queues: views come first, and the others are read in turn."""

from __future__ import annotations

from protocol.card import card_queue
from protocol.contract import denoise_queue, prepare_queue, render_queue
from protocol.terms import needs_queue
from protocol.view_parts import card_view_queue, view_queue
from worker.process.queue_order import VIEWS_A_BATCH, ViewsFirstOrder


def test_views_come_first_then_round_robin() -> None:
    view, render, prepare = view_queue("k"), render_queue("k"), prepare_queue("k")
    turns = ViewsFirstOrder()
    turns.update([render, view, prepare])
    assert turns.consume(3) == [view, render, prepare]
    turns.rotate(render)
    assert turns.consume(3) == [view, prepare, render]
    turns.rotate(prepare)
    assert turns.consume(3) == [view, render, prepare]
    turns.rotate(view)
    assert turns.consume(3) == [prepare, view, render], "a view may wait for what is prepared"
    turns.rotate(prepare)
    assert turns.consume(3)[0] == view


def test_denoising_takes_a_turn_after_each_message_of_a_view() -> None:
    """Otherwise the last picture of a job would wait until no live view is open any more."""
    view, render, prepare, denoise = view_queue("k"), render_queue("k"), prepare_queue("k"), denoise_queue("k")
    turns = ViewsFirstOrder()
    turns.update([render, view, prepare, denoise])
    assert turns.consume(4)[0] == view
    turns.rotate(view)
    assert turns.consume(4)[:3] == [denoise, prepare, view]
    turns.rotate(denoise)
    assert turns.consume(4)[0] == view, "views do not wait for many pictures"


def test_job_gets_batches_beside_a_busy_view() -> None:
    """With messages in all queues, as while a view is turned, every ninth is a batch."""
    view, render, needs = view_queue("k"), render_queue("k"), needs_queue("k", "tag:big")
    turns = ViewsFirstOrder()
    turns.update([render, view, needs, prepare_queue("k"), denoise_queue("k")])
    read: list[str] = []
    for _ in range(4 * (VIEWS_A_BATCH + 1)):
        (first,) = [each for each in turns.consume(5) if each in (view, render, needs)][:1]
        read.append(turns.rotate(first))
    views, batches = [view] * VIEWS_A_BATCH, read[VIEWS_A_BATCH :: VIEWS_A_BATCH + 1]
    assert read == [each for batch in batches for each in (*views, batch)]
    assert {*batches} == {render, needs}, "jobs with requirements and others in turn"


def test_views_precede_batches_of_a_card() -> None:
    view, batches = card_view_queue("w"), card_queue("w")
    turns = ViewsFirstOrder()
    turns.update([batches, view])
    assert turns.consume(2) == [view, batches]
    turns.rotate(view)
    assert turns.consume(2) == [view, batches]
