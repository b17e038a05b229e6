"""Explains a pixel: a worker renders its samples again and records each path, while the client's request waits."""

from __future__ import annotations

import json
import secrets
import threading
import time
from dataclasses import replace
from typing import Any

import redis

from protocol.explained import ExplainPixel, explained_key
from protocol.view_parts import view_queue
from renderer.sentences import Sentence, decoded
from service.errors import AnswerTimeout, Failed, FarmError, QueueError, Unavailable
from service.scheduling.artifacts.unfit_machines import MachineFault, UnfitMachines
from service.scheduling.dispatching.dispatcher import Dispatcher
from service.scheduling.faults.redis_errors import redis_unavailable
from service.scheduling.snapshot import SnapshotHolder

__all__ = ["PixelExplainer", "unreadable_answer"]

MAX_CONCURRENT = 4  # each blocks a thread of the service
START_TIMEOUT_S = 20.0  # until a slot starts; explanations precede batches
ANSWER_TIMEOUT_S = 60.0  # from the start; frames of animations are prepared first
COMPILE_S = 20.0  # loading a kernel takes seconds, compiling one minutes
POLL_S = 1.0
MAX_ATTEMPTS = 2


class PixelExplainer:
    """Sends explanation requests to workers and waits for their answers. Thread-safe; blocks the calling thread."""

    def __init__(self, connection: redis.Redis, dispatcher: Dispatcher, board: SnapshotHolder) -> None:
        """Stores the connections and the holder of the engine's snapshot. `stop` closes connection and dispatcher."""
        self._redis = connection
        self._dispatcher = dispatcher
        self._board = board
        self._room = threading.BoundedSemaphore(MAX_CONCURRENT)
        self._pending: set[object] = set()  # requests that are being answered
        self._stop = threading.Event()

    def stop(self) -> None:
        """Ends all waiting requests with an error, and closes the connections."""
        self._stop.set()
        self._dispatcher.close()
        self._redis.close()

    def kinds(self) -> list[str]:
        """Returns the worker kinds (renderer.jit.kind) that can explain pixels, those with most slots first.

        Any worker of a kind may receive the message, so a kind is included only if all its ready workers support explanations.
        Raises Unavailable if there is no such kind.
        """
        roster = self._board.roster
        ready = roster.ready_reports()
        unable = {report.kind for report in ready if not report.explains}
        kinds = sorted({report.kind for report in ready} - unable, key=lambda kind: (-roster.slots(kind), kind))
        if not kinds and not ready:
            raise Unavailable(
                Sentence(
                    "pixel-needs-worker",
                    "Explaining a pixel needs a worker, but none is ready. Start one, or resume a paused one, then try again.",
                )
            )
        if not kinds:
            raise Unavailable(
                Sentence(
                    "pixel-workers-too-old",
                    "The connected workers are of an older release, which cannot explain pixels. Start newer ones.",
                )
            )
        return kinds

    def has_unfinished(self) -> bool:
        """Returns True if a client waits for an explanation. Thread-safe."""
        return bool(self._pending)

    def explain(self, work: ExplainPixel, kind: str) -> dict[str, Any]:
        """Sends a request to a worker of this kind, and returns its explanation (worker/work/explain.py).

        The key `worker` of the explanation is the worker's name. work: the request; its message id is replaced. Raises
        Unavailable or AnswerTimeout, or Failed if the worker reports an error.
        """
        if not self._room.acquire(blocking=False):
            raise Unavailable(Sentence("pixel-requests-busy", "Other pixels are being explained. Try again in a moment."), 2.0)
        request = object()
        self._pending.add(request)
        try:
            unfit, queue, losses = UnfitMachines(), view_queue(kind), 0
            while losses < MAX_ATTEMPTS:
                answer = self._answer_of(replace(work, message=secrets.token_hex(8)), queue)
                if isinstance(answer, dict):
                    return answer
                losses += answer is None
                if isinstance(answer, MachineFault):
                    unfit.add(work.job, answer)
                if work.job in unfit:
                    able = [report for report in self._board.roster.ready_reports() if report.kind == kind and report.explains]
                    place = unfit.next_destination(work.job, able)
                    if place is None:
                        raise Failed(unfit.error_message(work.job, Sentence("task-explain-pixel", "explain this pixel")))
                    queue = place.queue
            raise Unavailable(
                Sentence("pixel-worker-lost", "The worker was lost while it traced the pixel's paths. Try again."),
                2.0,
            )
        except (redis.RedisError, QueueError) as error:
            raise redis_unavailable(error) from None
        finally:
            self._pending.discard(request)
            self._room.release()

    def _answer_of(self, work: ExplainPixel, queue: str) -> dict[str, Any] | MachineFault | None:
        """Sends a request to a queue and returns the worker's explanation.

        Returns the fault if the worker's machine cannot explain the pixel, and None if the worker was lost. Raises the errors
        of `explain`, and redis.RedisError and QueueError.
        """
        self._dispatcher.send_explain(work, queue)
        holder: str | None = None
        is_compiling = False
        deadline = time.monotonic() + START_TIMEOUT_S
        while not self._stop.is_set():
            if time.monotonic() > deadline:
                self._dispatcher.withdraw(queue, {work.message})
                raise _timeout(holder, is_compiling)
            found: Any = self._redis.blpop([explained_key(work.message)], timeout=POLL_S)
            if found is None:
                if holder is not None and holder not in self._board.roster.reports:
                    return None
                continue
            answer = _decoded_answer(found[1])
            match answer.get("type"):
                case "begun":
                    holder = str(answer.get("worker"))
                    deadline = time.monotonic() + ANSWER_TIMEOUT_S
                case "compiling":
                    is_compiling = True
                    deadline = time.monotonic() + COMPILE_S
                case "done":
                    return {**answer["explained"], "worker": holder}
                case "returned" if answer.get("unfit") is True:
                    return MachineFault(holder or Sentence("label-the-worker", "the worker"), _error_of(answer), passing=False)
                case "returned":
                    raise Unavailable(
                        Sentence(
                            "pixel-not-explained-retry",
                            "The pixel could not be explained: {reason}. Try again.",
                            reason=_error_of(answer),
                        ),
                        2.0,
                    )
                case _:
                    raise Failed(
                        Sentence("pixel-not-explained", "The pixel could not be explained: {reason}.", reason=_error_of(answer))
                    )
        raise Unavailable(Sentence("service-stopping-retry", "The service is shutting down. Try again when it is back."))


def _timeout(holder: str | None, is_compiling: bool) -> FarmError:
    """Returns the error for a request that was not answered in time. holder: the worker that has begun with it, if any."""
    if is_compiling:
        return Unavailable(
            Sentence(
                "pixel-kernel-compiling",
                "{worker} is compiling the kernel for it; this takes a minute or two, once. Try again then.",
                worker=holder,
            ),
            15.0,
        )
    late = (
        Sentence("pixel-worker-timeout", "{worker} did not answer in time.", worker=holder)
        if holder
        else Sentence("pixel-slots-busy", "No worker was free; all slots are busy.")
    )
    return AnswerTimeout(
        Sentence("pixel-not-explained-late", "The pixel could not be explained: {reason} Try again.", reason=late)
    )


def _decoded_answer(data: bytes) -> dict[str, Any]:
    """Decodes a worker's answer. Raises Failed if it is malformed."""
    try:
        answer = decoded(json.loads(data))
        if isinstance(answer, dict) and (answer.get("type") != "done" or isinstance(answer.get("explained"), dict)):
            return answer
    except (ValueError, RecursionError):
        pass
    raise unreadable_answer()


def unreadable_answer() -> Failed:
    """Returns the error for an answer that is not a valid explanation."""
    return Failed(
        Sentence(
            "worker-answer-unreadable", "The worker's answer cannot be read. Run the same release of Rayfarm on all machines."
        )
    )


def _error_of(answer: dict[str, Any]) -> str:
    return str(answer.get("error", ""))[:2000].rstrip(".")
