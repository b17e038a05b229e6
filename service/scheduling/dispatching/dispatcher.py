"""Interface through which the service sends work to the workers' queues, and withdraws it.

celery_dispatcher.py implements it with Celery. It is the only module of the service that constructs Celery messages. Workers over
HTTPS need no implementation of their own: the service relays their Redis connections (protocol/channel.py), so their queues are
those of any worker.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Protocol

from protocol.card import CardBatches
from protocol.contract import DenoiseFrame, FrameVectors, PrepareFrames, RenderBatch, ShowEnvironment, TrainPathGuide
from protocol.explained import ExplainPixel
from protocol.joint import JointBatch
from protocol.view_parts import ViewDenoise, ViewFrame, ViewParts

__all__ = ["Dispatcher"]


class Dispatcher(Protocol):
    """Sends tasks. The id of a task is that of its lease or message, so that waiting tasks can be identified and withdrawn."""

    def send_together(self) -> AbstractContextManager[None]:
        """Context manager that sends all messages together on exit, in one round trip to the broker.

        Raises QueueError. Then some messages may have been sent and others not, and the broker may have lost those in its queues.
        """

    def send_batch(self, batch: RenderBatch, queue: str) -> None:
        """Sends a batch. Raises QueueError."""

    def send_batches(self, batches: Sequence[RenderBatch], queue: str, message: str) -> None:
        """Sends one message, with the id `message`, whose batches a worker renders one after another. Raises QueueError."""

    def send_card(self, work: CardBatches, queue: str, message: str) -> None:
        """Sends one message, with the id `message`, whose batches a graphics card renders. Raises QueueError."""

    def send_joint(self, joint: JointBatch, queue: str) -> None:
        """Sends a message with batches of one tile, which the slots of one machine render in parallel. Raises QueueError."""

    def send_prepare(self, scene: str, queue: str, lease: str) -> None:
        """Sends a request to prepare a scene. Raises QueueError."""

    def send_frames(self, work: PrepareFrames, queue: str) -> None:
        """Sends a request to prepare frames of a shot. Raises QueueError."""

    def send_denoise(self, work: DenoiseFrame, queue: str) -> None:
        """Sends a request to denoise a frame. Raises QueueError."""

    def send_vectors(self, work: FrameVectors, queue: str) -> None:
        """Sends a request to compute a frame's motion vectors. Raises QueueError."""

    def send_view(self, work: ViewParts | ViewFrame | ViewDenoise, queue: str) -> None:
        """Sends a request to render parts of a live view, to denoise it, or to prepare its frame. Raises QueueError."""

    def send_environment(self, work: ShowEnvironment, queue: str) -> None:
        """Sends a request to make a thumbnail of an environment image. Raises QueueError."""

    def send_path_guide(self, work: TrainPathGuide, queue: str) -> None:
        """Sends a request to train a frame's path guide. Raises QueueError."""

    def send_explain(self, work: ExplainPixel, queue: str) -> None:
        """Sends a request to explain how a pixel got its colour. Raises QueueError."""

    def queue_length(self, queue: str) -> int:
        """Returns the number of messages in a queue that no worker has fetched yet. Raises redis.RedisError."""

    def waiting_messages(self, queue: str) -> dict[str, bytes]:
        """Returns the messages in a queue that no worker has fetched yet, by id. Raises redis.RedisError."""

    def withdraw(self, queue: str, messages: set[str]) -> set[str]:
        """Removes messages, given by id, from a queue. Returns the ids of the removed ones.

        Messages that a worker has already fetched are not removed. Raises redis.RedisError.
        """

    def recall(self, messages: set[str]) -> None:
        """Asks the slots that render these messages to return the batches that they have not begun. Raises redis.RedisError.

        A slot looks while it renders a batch, so it may begin one more.
        """

    def purge(self) -> None:
        """Removes all waiting messages of a previous run, since their leases no longer exist. Raises redis.RedisError."""

    def close(self) -> None:
        """Closes the connections to the broker."""
