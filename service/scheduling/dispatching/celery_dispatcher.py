"""The dispatcher implemented with Celery: sends tasks, and inspects the messages that wait in Redis."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from typing import Any

import redis
from celery import Celery
from kombu.exceptions import BatchPublishError, OperationalError

from protocol.broker import celery_config
from protocol.card import CARD_QUEUES, RENDER_ON_CARD, CardBatches
from protocol.contract import (
    DENOISE,
    ENVIRONMENT,
    PATH_GUIDE,
    PREPARE,
    PREPARE_FRAMES,
    RENDER_BATCH,
    RENDER_BATCHES,
    VECTORS,
    DenoiseFrame,
    FrameVectors,
    PrepareFrames,
    RenderBatch,
    ShowEnvironment,
    TrainPathGuide,
    denoise_queue,
    prepare_queue,
    recall_key,
    render_queue,
)
from protocol.explained import EXPLAIN, ExplainPixel
from protocol.joint import HELP_QUEUES, RENDER_JOINTLY, JointBatch
from protocol.view_parts import (
    CARD_VIEW_QUEUES,
    DENOISE_VIEW,
    RENDER_VIEW,
    VIEW_ANSWERS,
    VIEW_FRAME,
    ViewDenoise,
    ViewFrame,
    ViewParts,
    view_queue,
)
from service.errors import FarmError, QueueError
from service.scheduling.jobs.traces import trace_headers

__all__ = ["CeleryDispatcher"]

RECALL_TTL_S = 120  # longer than a message with several batches takes
_UNREACHABLE = (OperationalError, BatchPublishError, redis.RedisError, OSError)


class CeleryDispatcher:
    """Implements service.scheduling.dispatching.dispatcher.Dispatcher."""

    def __init__(self, redis_url: str, connection: redis.Redis, guard: Callable[[], None] = lambda: None) -> None:
        """Connects to the broker. guard: raises FarmError if this service does not own the farm and therefore may not send."""
        self._redis = connection
        self._guard = guard
        self._producer: Any = None  # set while several messages are sent at once
        self._celery = Celery("rayfarm-service", set_as_current=False)
        self._celery.conf.update(celery_config(redis_url))
        self._celery.conf.broker_connection_timeout = 2
        self._celery.conf.broker_transport_options = {
            **self._celery.conf.broker_transport_options,
            "socket_connect_timeout": 2,
            "socket_timeout": 5,
        }

    @contextmanager
    def send_together(self) -> Iterator[None]:
        """Context manager that sends all messages together on exit, in one round trip to the broker.

        Raises QueueError. Then some messages may have been sent and others not, and the broker may have lost those in its queues.
        """
        try:
            with self._celery.producer_or_acquire() as producer, producer.batch():
                self._producer = producer
                try:
                    yield
                finally:
                    self._producer = None
                self._check_ownership()
        except _UNREACHABLE as error:
            raise QueueError(str(error)) from error

    def send_batch(self, batch: RenderBatch, queue: str) -> None:
        """Sends a batch. Raises QueueError."""
        self._send(RENDER_BATCH, {"batch": batch.to_json()}, queue, batch.batch, ("job", batch.job))

    def send_batches(self, batches: Sequence[RenderBatch], queue: str, message: str) -> None:
        """Sends one message, with the id `message`, whose batches a worker renders one after another. Raises QueueError."""
        self._send(
            RENDER_BATCHES,
            {"batches": [batch.to_json() for batch in batches]},
            queue,
            message,
            ("job", batches[0].job),
        )

    def send_card(self, work: CardBatches, queue: str, message: str) -> None:
        """Sends one message, with the id `message`, whose batches a graphics card renders. Raises QueueError."""
        self._send(RENDER_ON_CARD, {"card": work.to_json()}, queue, message, ("job", work.batches[0].job))

    def send_joint(self, joint: JointBatch, queue: str) -> None:
        """Sends a message with batches of one tile, which the slots of one machine render in parallel. Raises QueueError."""
        whole = joint.whole
        self._send(RENDER_JOINTLY, {"joint": joint.to_json()}, queue, whole.batch, ("job", whole.job))

    def send_prepare(self, scene: str, queue: str, lease: str) -> None:
        """Sends a request to prepare a scene. Raises QueueError."""
        self._send(PREPARE, {"scene": scene}, queue, lease, ("scene", scene))

    def send_frames(self, work: PrepareFrames, queue: str) -> None:
        """Sends a request to prepare frames of a shot. Raises QueueError."""
        self._send(PREPARE_FRAMES, {"frames": work.to_json()}, queue, work.work, ("job", work.job))

    def send_denoise(self, work: DenoiseFrame, queue: str) -> None:
        """Sends a request to denoise a frame. Raises QueueError."""
        self._send(DENOISE, {"frame": work.to_json()}, queue, work.work, ("job", work.job))

    def send_vectors(self, work: FrameVectors, queue: str) -> None:
        """Sends a request to compute a frame's motion vectors. Raises QueueError."""
        self._send(VECTORS, {"vectors": work.to_json()}, queue, work.work, ("job", work.job))

    def send_view(self, work: ViewParts | ViewFrame | ViewDenoise, queue: str) -> None:
        """Sends a request to render parts of a live view, to denoise it, or to prepare its frame. Raises QueueError."""
        name, argument = {
            ViewParts: (RENDER_VIEW, "parts"),
            ViewFrame: (VIEW_FRAME, "frame"),
            ViewDenoise: (DENOISE_VIEW, "picture"),
        }[type(work)]
        self._send(name, {argument: work.to_json()}, queue, work.message)

    def send_path_guide(self, work: TrainPathGuide, queue: str) -> None:
        """Sends a request to train a frame's path guide. Raises QueueError."""
        self._send(PATH_GUIDE, {"guide": work.to_json()}, queue, work.work, ("job", work.job))

    def send_environment(self, work: ShowEnvironment, queue: str) -> None:
        """Sends a request to make a thumbnail of an environment image. Raises QueueError."""
        self._send(ENVIRONMENT, {"environment": asdict(work)}, queue, work.work)

    def send_explain(self, work: ExplainPixel, queue: str) -> None:
        """Sends a request to explain how a pixel got its colour. Raises QueueError."""
        self._send(EXPLAIN, {"pixel": work.to_json()}, queue, work.message)

    def queue_length(self, queue: str) -> int:
        """Returns the number of messages in a queue that no worker has fetched yet. Raises redis.RedisError."""
        length: Any = self._redis.llen(queue)
        return int(length)

    def waiting_messages(self, queue: str) -> dict[str, bytes]:
        """Returns the messages in a queue that no worker has fetched yet, by id. Raises redis.RedisError."""
        found = {}
        messages: Any = self._redis.lrange(queue, 0, -1)
        for message in messages:
            try:
                found[str(json.loads(message)["headers"]["id"])] = message
            except (ValueError, KeyError, TypeError):
                continue
        return found

    def withdraw(self, queue: str, messages: set[str]) -> set[str]:
        """Removes messages, given by id, from a queue. Returns the ids of the removed ones.

        Messages that a worker has already fetched are not removed. Raises redis.RedisError.
        """
        taken = set()
        for id, message in self.waiting_messages(queue).items():
            if id in messages and self._redis.lrem(queue, 1, message):  # type: ignore[arg-type]
                taken.add(id)
        return taken

    def recall(self, messages: set[str]) -> None:
        """Asks the slots that render these messages to return the batches that they have not begun. Raises redis.RedisError."""
        with self._redis.pipeline(transaction=False) as keys:
            for message in messages:
                keys.set(recall_key(message), 1, ex=RECALL_TTL_S)
            keys.execute()

    def purge(self) -> None:
        """Removes all waiting messages of a previous run, since their leases no longer exist. Raises redis.RedisError."""
        for pattern in (
            render_queue("*"),
            prepare_queue("*"),
            denoise_queue("*"),
            view_queue("*"),
            f"{HELP_QUEUES}*",
            f"{CARD_QUEUES}*",
            f"{CARD_VIEW_QUEUES}*",
        ):
            for name in self._redis.scan_iter(pattern, count=1000):
                self._redis.delete(name)
        self._redis.delete(VIEW_ANSWERS)

    def _check_ownership(self) -> None:
        try:
            self._guard()
        except FarmError as error:
            raise QueueError(str(error)) from error

    def close(self) -> None:
        """Closes the connections to the broker."""
        self._celery.close()

    def _send(self, name: str, arguments: dict[str, Any], queue: str, lease: str, traced: tuple[str, str] | None = None) -> None:
        """Sends a Celery task. name, arguments: of the task. lease: id of the task.

        traced: kind ("job" or "scene") and id of the item to whose trace the task belongs, or None.
        """
        self._check_ownership()
        try:
            options: dict[str, Any] = {
                "ignore_result": True,
                "retry": False,
                "argsrepr": "",
                "kwargsrepr": "",
            }  # the reprs are unused
            if traced is not None and (headers := trace_headers(*traced)) is not None:
                options["headers"] = headers
            self._celery.send_task(name, kwargs=arguments, queue=queue, task_id=lease, producer=self._producer, **options)
        except _UNREACHABLE as error:
            raise QueueError(str(error)) from error
