"""Renders parts of live views (interactive pictures without a job), and prepares the animation frames that views show."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import Any

import redis

from protocol.sums import pack_sums
from protocol.view_parts import (
    ANSWERS_TTL_S,
    MAX_ANSWERS,
    VIEW_ANSWERS,
    Part,
    ViewAnswer,
    ViewDenoise,
    ViewFrame,
    ViewParts,
    view_key,
)
from renderer.errors import RayfarmError
from renderer.film import ALBEDO, COLOR, NORMAL, SAMPLES, Sums, alpha_plane
from renderer.render import is_warm, render_batch, settings_as_rendered, variant_for
from renderer.sentences import Sentence
from worker.exchange.errors import MachineError, RefusedError, TemporaryError, UnfitError
from worker.exchange.ready import has_kernels, make_kernel_ready, pilot_readiness
from worker.exchange.retry import retry_temporary
from worker.process.context import WorkerContext
from worker.work.frames import prepare_frames
from worker.work.open_scenes import mapped_scene
from worker.work.scenes import scene_not_fetched

__all__ = ["ViewAnswers", "pack_view_sums", "prepare_view_frame", "render_view", "view_failed"]

PATIENCE_S = 5.0  # seconds to retry an unreachable service; a client waits

log = logging.getLogger(__name__)


class ViewAnswers:
    """Sends the answers to one view message. If Redis is unreachable, answers are lost and requested again."""

    def __init__(self, worker: WorkerContext, work: ViewParts | ViewFrame | ViewDenoise) -> None:
        self._redis = worker.results.redis
        self._about = (work.watch, work.view, work.message, worker.name)
        self._key, self._view = view_key(work.watch), str(work.view).encode()

    def send(self, type: str, sums: bytes = b"", **more: Any) -> None:
        """Sends an answer of this type. sums: the packed sums of a part. more: further fields."""
        answer = ViewAnswer(type, *self._about, more, sums).to_bytes()
        try:
            with self._redis.pipeline(transaction=False) as at_once:
                at_once.rpush(VIEW_ANSWERS, answer)
                at_once.ltrim(VIEW_ANSWERS, -MAX_ANSWERS, -1)
                at_once.expire(VIEW_ANSWERS, ANSWERS_TTL_S)
                at_once.execute()
        except (redis.RedisError, OSError) as error:
            log.warning("an answer about a view is lost: %s", error)

    def is_wanted(self) -> bool:
        """Returns True if the message's view is still the current one."""
        try:
            return bool(self._redis.get(self._key) == self._view)
        except (redis.RedisError, OSError):
            return False


def view_failed(worker: WorkerContext, error: Exception) -> Sentence:
    """Returns the sentence for an unexpected error while a view is rendered."""
    return Sentence(
        "worker-view-failed",
        "{worker} could not render the view ({kind}: {error}).",
        worker=worker.name,
        kind=type(error).__name__,
        error=error,
    )


def render_view(worker: WorkerContext, work: ViewParts, compiling: Callable[[bool], None]) -> float:
    """Renders parts of a view until all are done or the viewer has changed it. Returns the samples per second.

    Returns 0 if none was rendered, or only first hits, which cost a fraction of a sample. compiling: called with True
    before the scene's kernel is made ready, and with False afterwards.
    """
    answering = ViewAnswers(worker, work)
    if not answering.is_wanted():
        return 0.0
    answering.send("begun")
    samples, seconds = 0, 0.0
    try:
        scene = retry_temporary(lambda: mapped_scene(worker, work.compiled), PATIENCE_S)
        variant = variant_for(work.settings, scene)
        if work.needs_kernel and not has_kernels(worker.link, work.settings, variant):
            answering.send("declined")
            return 0.0
        kernel = settings_as_rendered(work.settings, scene, pilot_readiness(worker.link, compiling))
        if not is_warm(kernel, variant):
            compiling(True)
            answering.send("compiling")
            make_kernel_ready(worker.link, kernel, variant)
            compiling(False)
        for part in work.parts:
            if not answering.is_wanted():
                break
            begun = time.perf_counter()
            sums = render_batch(scene, work.settings, part.tile, part.first, part.count).sums
            taken = time.perf_counter() - begun
            answering.send("part", pack_view_sums(sums, work), number=part.number, seconds=taken)
            samples, seconds = samples + _samples(part), seconds + taken
        answering.send("over")
    except TemporaryError as error:
        answering.send(
            "returned",
            error=Sentence("worker-returned-view", "{worker} returned a view: {error}", worker=worker.name, error=error),
        )
    except RefusedError as error:
        answering.send("returned", error=scene_not_fetched(worker, error))
    except RayfarmError as error:
        answering.send("failed", error=str(error))
    except MemoryError:
        answering.send(
            "returned",
            error=Sentence("worker-memory-exhausted", "{worker} has too little memory for this scene.", worker=worker.name),
        )
    except Exception as error:  # any error fails this view only, not the worker
        log.exception("a view failed")
        answering.send("failed", error=view_failed(worker, error))
    return samples / seconds if seconds and not work.is_first_hits else 0.0


def prepare_view_frame(worker: WorkerContext, work: ViewFrame) -> None:
    """Compiles the animation frames that a view requests, and sends an answer for each."""
    answering = ViewAnswers(worker, work)
    if not answering.is_wanted():
        return
    answering.send("begun")

    def send_answer(kind: str, **more: Any) -> None:
        answering.send({"frame-prepared": "frame", "frame-failed": "failed"}.get(kind, "returned"), **more)

    try:
        manifest = retry_temporary(lambda: worker.link.manifest(work.work.scene), PATIENCE_S)
        prepare_frames(worker, manifest, work.work, send_answer)
        answering.send("over")
    except (UnfitError, MachineError) as error:
        answering.send("returned", error=str(error), unfit=True)
    except MemoryError:
        answering.send(
            "returned", error=Sentence("frame-memory-exhausted", "there is too little memory for this frame"), unfit=True
        )
    except (TemporaryError, RefusedError) as error:
        answering.send(
            "returned",
            error=Sentence("worker-returned-frame", "{worker} returned a frame: {error}", worker=worker.name, error=error),
        )
    except Exception as error:
        log.exception("a frame of a view failed")
        answering.send(
            "failed",
            error=Sentence(
                "worker-frame-failed",
                "{worker} could not prepare the frame ({kind}: {error}).",
                worker=worker.name,
                kind=type(error).__name__,
                error=error,
            ),
        )


def pack_view_sums(sums: Sums, work: ViewParts) -> bytes:
    """Packs the sums of a part, (planes, h, w) int64: without the planes that the view does not use, unless it wants all."""
    if work.is_whole:
        return pack_sums(sums)
    guides = (ALBEDO, NORMAL) if work.has_guides else ()
    used = COLOR, slice(SAMPLES, SAMPLES + 1), slice(alpha_plane(0), None), *guides
    return pack_sums(sums, planes={plane for each in used for plane in range(*each.indices(len(sums)))})


def _samples(part: Part) -> int:
    return part.tile.w * part.tile.h * part.count
