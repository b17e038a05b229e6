"""Interface through which the service sends work to the workers' queues, and withdraws it.

Implemented with Celery by celery_dispatcher.py, the only module of the service that constructs messages of Celery.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Protocol

from protocol.card import CardBatches
from protocol.contract import DenoiseFrame, FrameVectors, PrepareFrames, RenderBatch, ShowEnvironment
from protocol.explained import ExplainPixel
from protocol.joint import JointBatch
from protocol.view_parts import ViewFrame, ViewParts

__all__ = ["Dispatcher"]


class Dispatcher(Protocol):
    """Sends tasks. A task has the id of its lease or message, so waiting tasks can be identified and withdrawn."""

    def send_together(self) -> AbstractContextManager[None]:
        """Context manager that sends all messages together on exit, in one round trip to the broker.

        Raises QueueError. Then some messages may have been sent and others not, and the broker may have lost those in its queues.
        """

    def send_batch(self, batch: RenderBatch, queue: str) -> None:
        """Sends a batch. Raises QueueError."""

    def send_batches(self, batches: Sequence[RenderBatch], queue: str, message: str) -> None:
        """Sends batches to be rendered one after another, in one message with this id. Raises QueueError."""

    def send_card(self, work: CardBatches, queue: str, message: str) -> None:
        """Sends batches for a graphics card in one message with this id. Raises QueueError."""

    def send_joint(self, joint: JointBatch, queue: str) -> None:
        """Sends a message with batches of one tile, which the slots of one machine render in parallel. Raises QueueError."""

    def send_prepare(self, scene: str, queue: str, lease: str) -> None:
        """Sends a request to prepare a scene. Raises QueueError."""

    def send_frames(self, work: PrepareFrames, queue: str) -> None:
        """Sends a request to prepare frames of a shot. Raises QueueError."""

    def send_denoise(self, work: DenoiseFrame, queue: str) -> None:
        """Sends a request to denoise a frame. Raises QueueError."""

    def send_vectors(self, work: FrameVectors, queue: str) -> None:
        """Sends a request for a frame's motion vectors. Raises QueueError."""

    def send_view(self, work: ViewParts | ViewFrame, queue: str) -> None:
        """Sends a request for pieces of a view, or for animation frames that it shows. Raises QueueError."""

    def send_environment(self, work: ShowEnvironment, queue: str) -> None:
        """Sends a request for a thumbnail of an environment image. Raises QueueError."""

    def send_explain(self, work: ExplainPixel, queue: str) -> None:
        """Sends a request to explain a pixel. Raises QueueError."""

    def waiting_messages(self, queue: str) -> dict[str, bytes]:
        """Returns the messages in a queue that no worker has fetched yet, by id. Raises redis.RedisError."""

    def withdraw(self, queue: str, messages: set[str]) -> set[str]:
        """Removes messages from a queue if no worker has fetched them; returns the ids of those removed.

        Raises redis.RedisError.
        """

    def purge(self) -> None:
        """Removes all waiting messages of a previous run, whose leases no longer exist. Raises redis.RedisError."""

    def close(self) -> None:
        """Closes the connections to the broker."""
