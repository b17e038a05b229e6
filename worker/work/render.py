"""Renders a batch: maps the compiled scene, runs the kernel, and returns the sums of the samples."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from protocol.contract import RenderBatch, Result
from protocol.reproduce import batch_command
from protocol.sums import PACKED, pack_sums
from renderer.errors import RayfarmError
from renderer.film import BatchSums
from renderer.kernel.accumulate import samples_guide
from renderer.render import is_warm, render_batch, settings_as_rendered, variant_for
from renderer.sentences import Sentence
from renderer.settings import RenderSettings
from worker.exchange.errors import RefusedError, TemporaryError
from worker.exchange.link import Link
from worker.exchange.ready import make_kernel_ready, make_pilot_ready
from worker.exchange.retry import retry_temporary
from worker.process.context import WorkerContext
from worker.process.slot_number import slot
from worker.telemetry.batch_warnings import step
from worker.work.open_scenes import mapped_scene
from worker.work.path_guides import use_stored_guide
from worker.work.scenes import scene_not_fetched

__all__ = [
    "PATIENCE_S",
    "BatchOutcome",
    "batch_event",
    "failure_event",
    "recalled_event",
    "render",
    "rendered_outcome",
    "returned_event",
    "unreadable_batch_event",
]

# Seconds to retry an unreachable service, less than a batch's lease.
PATIENCE_S = 30.0
TRACE_LINES, TRACE_CHARACTERS = 6, 1500


@dataclass(frozen=True)
class BatchOutcome:
    """Outcome of a batch: its event, and its exact sums, which are packed when the result is made; None if it has none."""

    event: dict[str, Any]
    sums: BatchSums | None = None
    packing: int = PACKED

    def result(self) -> Result:
        """Returns the result to send, with its sums packed."""
        if self.sums is None:
            return Result(self.event)
        with step("pack sums", slot=slot()):
            return Result(self.event, pack_sums(self.sums.sums, self.packing, self.sums.hits, self.sums.deep))


def render(
    worker: WorkerContext, batch: RenderBatch, compiling: Callable[[bool], None], begins: Callable[[], None] = lambda: None
) -> BatchOutcome:
    """Renders a batch. Returns its exact sums, or the event of a failed or returned batch with the reason.

    compiling: called with True before the scene's kernel is made ready, and with False afterwards. begins: called right before
    the kernel runs, which needs no interpreter: the time for threads to do other work, which would delay this thread earlier.
    Also called before that if the kernel has to be compiled, since what waits for it would wait for minutes.
    """
    try:
        with step("open scene", slot=slot()):
            scene = retry_temporary(lambda: mapped_scene(worker, batch.compiled), PATIENCE_S)
        variant = variant_for(batch.settings, scene)

        def prepare(settings: RenderSettings, make_ready: Callable[[Link, RenderSettings, str], None]) -> None:
            begins()
            compiling(True)
            with step("kernel"):
                make_ready(worker.link, settings, variant)
            compiling(False)

        if samples_guide(batch.settings):
            use_stored_guide(worker, scene, batch.settings, batch.guide)
        kernel = settings_as_rendered(batch.settings, scene, lambda settings, _: prepare(settings, make_pilot_ready))
        if not is_warm(kernel, variant):
            prepare(kernel, make_kernel_ready)
        begun = time.perf_counter()
        with step("trace paths", slot=slot(), first=batch.first, count=batch.count, tile=list(batch.tile)):
            sums = render_batch(scene, batch.settings, batch.tile, batch.first, batch.count, begins=begins)
    except TemporaryError as error:
        failed = returned_event(
            worker,
            batch,
            Sentence("worker-returned-batch", "{worker} returned a batch: {error}", worker=worker.name, error=error),
        )
    except RefusedError as error:
        failed = failure_event(
            worker,
            batch,
            scene_not_fetched(worker, error),
        )
    except RayfarmError as error:
        failed = failure_event(worker, batch, str(error))
    except MemoryError:
        failed = failure_event(
            worker,
            batch,
            Sentence(
                "worker-out-of-memory",
                "{worker} has too little memory for this scene. Simplify the scene, or use a machine with more memory",
                worker=worker.name,
            ),
        )
    except Exception as error:  # any error fails this batch only, not the worker
        last = "".join(traceback.format_exception(error)[-TRACE_LINES:])[-TRACE_CHARACTERS:]
        failed = failure_event(
            worker,
            batch,
            Sentence("rendering-failed", "rendering failed unexpectedly ({error})", error=f"{type(error).__name__}: {error}"),
            last,
        )
    else:
        return rendered_outcome(worker, batch, sums, time.perf_counter() - begun)
    return BatchOutcome(failed.event)


def rendered_outcome(worker: WorkerContext, batch: RenderBatch, sums: BatchSums, seconds: float) -> BatchOutcome:
    """Returns the outcome of a rendered batch. seconds: rendering time."""
    event = {
        **batch_event(worker, batch, "batch"),
        "seconds": seconds,
        "bad": [list(bad) for bad in sums.bad],
        "bad_count": sums.bad_count,
    }
    return BatchOutcome(event, sums, batch.packing)


def failure_event(worker: WorkerContext, batch: RenderBatch, error: str, trace: str = "") -> Result:
    """Returns the result of a failed batch. error: the reason, as a sentence. trace: the last lines of the traceback."""
    command = batch_command(batch.settings, batch.tile, batch.first, batch.count)
    return Result({**batch_event(worker, batch, "batch-failed"), "error": error, "reproduce": command, "trace": trace})


def returned_event(worker: WorkerContext, batch: RenderBatch, error: str) -> Result:
    """Returns the result of a batch that this worker gives back because of a fault of its own, such as a full disk."""
    return Result({**batch_event(worker, batch, "batch-returned"), "error": error})


def recalled_event(worker: WorkerContext, batch: RenderBatch) -> Result:
    """Returns the result of a batch that was not begun when the service recalled its message."""
    sentence = Sentence("worker-message-recalled", "{worker} returned a batch that the service recalled", worker=worker.name)
    return Result({**returned_event(worker, batch, sentence).event, "recalled": True})


def unreadable_batch_event(worker: WorkerContext, batch: dict[str, Any], error: Exception) -> Result:
    """Returns the result of a batch that this release cannot parse. batch: the message, from RenderBatch.to_json."""
    event = {key: batch.get(key) for key in ("batch", "job", "frame", "tile", "first", "count")}
    sentence = Sentence(
        "worker-batch-unreadable",
        "{worker} cannot read the batch ({error}). Run the same release of Rayfarm on all machines.",
        worker=worker.name,
        error=error,
    )
    return Result({"type": "batch-failed", **event, "worker": worker.name, "error": sentence, "reproduce": None})


def batch_event(worker: WorkerContext, batch: RenderBatch, kind: str) -> dict[str, Any]:
    """Returns the fields that all events about a batch have. kind: the event's type."""
    return {
        "type": kind,
        "batch": batch.batch,
        "job": batch.job,
        "frame": batch.frame,
        "tile": list(batch.tile),
        "first": batch.first,
        "count": batch.count,
        "worker": worker.name,
    }
