"""Port through which the service sends work to the queues of workers, and takes it back.

Implemented with Celery by celery_dispatcher.py, the only module of the service that constructs messages of Celery.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import Protocol

from protocol.contract import DenoiseFrame, FrameVectors, PrepareFrames, RenderBatch, ShowEnvironment
from protocol.explained import ExplainPixel
from protocol.joint import JointBatch
from protocol.view_parts import ViewFrame, ViewParts

__all__ = ["Dispatcher"]


class Dispatcher(Protocol):
    """Sends tasks. A task's id is that of its lease or message, so waiting tasks can be identified and withdrawn."""

    def at_once(self) -> AbstractContextManager[None]:
        """Context that sends all its messages together at its end, with one round trip to the broker.

        Raises QueueError; some messages may then have been sent, and the others are lost, as are those waiting in a broker that
        stops.
        """

    def send_batch(self, batch: RenderBatch, queue: str) -> None:
        """Sends a batch. Raises QueueError."""

    def send_batches(self, batches: Sequence[RenderBatch], queue: str, message: str) -> None:
        """Sends batches to be rendered one after another, in one message with this id. Raises QueueError."""

    def send_joint(self, joint: JointBatch, queue: str) -> None:
        """Sends batches of one tile, to be rendered in parallel by the slots of one machine. Raises QueueError."""

    def send_prepare(self, scene: str, queue: str, lease: str) -> None:
        """Sends a request to prepare a scene. Raises QueueError."""

    def send_frames(self, work: PrepareFrames, queue: str) -> None:
        """Sends a request to prepare frames of a shot. Raises QueueError."""

    def send_denoise(self, work: DenoiseFrame, queue: str) -> None:
        """Sends a request to denoise a frame. Raises QueueError."""

    def send_vectors(self, work: FrameVectors, queue: str) -> None:
        """Sends a request for a frame's motion vectors. Raises QueueError."""

    def send_view(self, work: ViewParts | ViewFrame, queue: str) -> None:
        """Sends a request for parts of a view, or for the frames that it shows. Raises QueueError."""

    def send_environment(self, work: ShowEnvironment, queue: str) -> None:
        """Sends a request for a thumbnail of an environment image. Raises QueueError."""

    def send_explain(self, work: ExplainPixel, queue: str) -> None:
        """Sends a request to explain a pixel. Raises QueueError."""

    def waiting(self, queue: str) -> dict[str, bytes]:
        """Returns the messages of a queue that no worker has taken yet, by id. Raises redis.RedisError."""

    def take_back(self, queue: str, messages: set[str]) -> set[str]:
        """Removes waiting messages and returns the ids of those removed. Raises redis.RedisError."""

    def purge(self) -> None:
        """Removes all waiting messages of a previous run, whose leases no longer exist. Raises redis.RedisError."""

    def close(self) -> None:
        """Closes its connections to the broker."""
