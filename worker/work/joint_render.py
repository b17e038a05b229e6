"""Joint rendering: the slots of a worker render pieces of one tile, and the worker sends the sum of their results.

Integer sums are exact. A result costs the service about the same whatever its number of samples, so few large results are best.

The slot that takes a joint batch from the queue makes its pieces available to all slots, sends them help messages, which
precede other batches, and renders one piece itself. The slot that renders the last piece sends the sums. If sums have waited
for the batch's `hold_s` seconds, a slot that ends a piece sends them without the missing ones.
"""

from __future__ import annotations

import contextlib
import json
import logging
from dataclasses import replace
from typing import Any

import redis
from celery import Celery
from kombu.exceptions import BatchPublishError, OperationalError

from protocol.contract import Result, render_queue
from protocol.joint import HELP, RENDER_JOINTLY, JointBatch, Piece, help_queue
from telemetry.log_lines import about
from worker.machine.joint_pieces import ClaimedPiece
from worker.process.context import WorkerContext
from worker.site.merging import merged_results
from worker.telemetry.task_context import message_ids
from worker.work.slot import rendering_batch

__all__ = ["ask_for_help", "remaining_pieces", "render_waiting_piece", "send_all_sums", "share_pieces"]

_AWAY = (OperationalError, BatchPublishError, redis.RedisError, OSError)

log = logging.getLogger(__name__)


def share_pieces(app: Celery, worker: WorkerContext, joint: JointBatch, message: str) -> bool:
    """Offers the pieces of a joint batch (protocol/joint.py) to all slots of this worker; the rest returns to the queue.

    message: id of the Celery message. Returns False if the files through which slots share pieces cannot be written.
    """
    if worker.pieces is None:
        return False
    most = max(2, worker.slots)
    try:
        worker.pieces.add_message(message, json.dumps(joint.to_json()).encode(), range(most)[: len(joint.pieces)], joint.hold_s)
    except (OSError, ValueError) as error:
        log.warning("slots cannot share a batch, so one slot renders it alone: %s", error)
        return False
    if len(joint.pieces) > most:  # other machines may have slots for them
        try:
            _requeue(app, worker, joint, joint.pieces[most:])
        except _AWAY as error:
            log.warning("pieces are lost and will be dispatched again: %s", error)
    ask_for_help(app, worker, min(most, len(joint.pieces)) - 1)
    return True


def remaining_pieces(worker: WorkerContext, joint: JointBatch, message: str) -> list[int]:
    """Returns the indices of the pieces of a redelivered message that no live slot of this worker has rendered or claimed.

    Returns all pieces if the folder of pieces does not have the message.
    """
    with contextlib.suppress(OSError):
        if worker.pieces is not None and (left := worker.pieces.withdraw_unfinished(message)) is not None:
            return left
    return [*range(len(joint.pieces))]


def ask_for_help(app: Celery, worker: WorkerContext, slots: int) -> None:
    """Sends this many messages to this worker's own queue, each asking a slot to render a waiting piece.

    If Redis is unreachable, the heartbeat sends them later.
    """
    options = {"queue": help_queue(worker.name), "ignore_result": True, "retry": False}
    try:
        with app.producer_or_acquire() as producer, producer.batch():
            for _ in range(slots):
                app.send_task(HELP, kwargs={"asked": {}}, producer=producer, **options)
    except _AWAY as error:
        log.warning("slots cannot be notified of a batch yet: %s", error)


def render_waiting_piece(worker: WorkerContext) -> None:
    """Renders a waiting piece if there is one, and sends the sums that are due."""
    if worker.pieces is None:
        return
    try:
        taken = worker.pieces.claim()
        if taken is not None:
            _render(worker, taken)
        for results in worker.pieces.due_results():
            _send(worker, results)
    except OSError as error:  # lost pieces are handed out again when their lease expires
        log.warning("sums of a batch are lost: %s", error)


def send_all_sums(app: Celery, worker: WorkerContext) -> None:
    """Sends all sums at once and returns unclaimed pieces to the queue, when the worker shuts down."""
    if worker.pieces is None:
        return
    try:
        for words, numbers in worker.pieces.withdraw():
            joint = JointBatch.from_json(json.loads(words))
            _requeue(app, worker, joint, tuple(joint.pieces[number] for number in numbers))
        for results in worker.pieces.due_results(at_once=True):
            _send(worker, results)
    except _AWAY as error:
        log.warning("the rest of a batch is lost and will be dispatched again: %s", error)


def _requeue(app: Celery, worker: WorkerContext, joint: JointBatch, pieces: tuple[Piece, ...]) -> None:
    rest = replace(joint, pieces=pieces)
    options: dict[str, Any] = {"ignore_result": True, "retry": False, "task_id": joint.whole.batch}
    queue = worker.queue_of_returned(joint.queue or render_queue(worker.kind))
    app.send_task(RENDER_JOINTLY, kwargs={"joint": rest.to_json()}, queue=queue, **options)


def _render(worker: WorkerContext, piece: ClaimedPiece) -> None:
    assert worker.pieces is not None
    joint = JointBatch.from_json(json.loads(piece.about))
    work = joint.batch(piece.number)
    with about(**message_ids(vars(work))), rendering_batch(worker, work, joint.whole.batch) as do:
        result = do().result()
        if result.sums is not None:
            if joint.run is not None:
                result.event["run"] = list(joint.run)
            try:
                worker.pieces.store_result(piece, result)
                return
            except OSError as error:
                log.warning("sums are sent separately, since they cannot be stored: %s", error)
        worker.results.send(result)
        worker.pieces.release(piece)


def _send(worker: WorkerContext, results: list[Result]) -> None:
    for result in merged_results(results):
        if not worker.sites.send(result):
            worker.results.send(result)
