"""The Celery tasks. Their arguments are ids and numbers; files are sent over HTTP, results over a Redis stream."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from operator import call
from typing import Any

from celery import Celery

from protocol.card import RENDER_ON_CARD, CardBatches
from protocol.contract import (
    DENOISE,
    ENVIRONMENT,
    PATH_GUIDE,
    PREPARE,
    PREPARE_FRAMES,
    RENDER_BATCH,
    RENDER_BATCHES,
    VECTORS,
    PrepareFrames,
    RenderBatch,
    Result,
    SceneInfo,
    ScenePreview,
)
from protocol.explained import EXPLAIN, ExplainPixel
from protocol.joint import HELP, RENDER_JOINTLY, JointBatch
from protocol.view_parts import DENOISE_VIEW, RENDER_VIEW, VIEW_FRAME, ViewDenoise, ViewFrame, ViewParts
from renderer.errors import RayfarmError
from renderer.sentences import Sentence
from renderer.settings import Tile
from telemetry.log_lines import about
from worker.exchange.errors import MachineError, RefusedError, TemporaryError, UnfitError, WorkerError, WorkError
from worker.exchange.recall import Recall
from worker.exchange.retry import retry_temporary
from worker.exchange.sums_sender import Send, SumsSender
from worker.process import context
from worker.process.slot_number import slot
from worker.telemetry.batch_warnings import step
from worker.telemetry.task_context import Steps, message_ids, traced_task
from worker.work.deaths import DEATHS_ALLOWED, count_deaths, is_redelivered, reset_deaths
from worker.work.denoise_view import denoise_view
from worker.work.derived_artifacts import DENOISING, ENVIRONMENTS, MOTION_VECTORS, PATH_GUIDES
from worker.work.explain import explain_pixel, send_answer
from worker.work.frames import prepare_frames
from worker.work.joint_render import remaining_pieces, render_waiting_piece, share_pieces
from worker.work.open_scenes import SceneOpener, is_mapped
from worker.work.prepare import prepare_scene
from worker.work.render import failure_event, recalled_event, unreadable_batch_event
from worker.work.scenes import discard_damaged
from worker.work.slot import SlotTask, rendering_batch
from worker.work.slot_card import Block, render_on_card, return_to_cpus
from worker.work.thumbnail import make_thumbnail
from worker.work.view_card import render_view_on_card
from worker.work.viewport import ViewAnswers, prepare_view_frame, render_view

__all__ = ["register"]

LINK_TIMEOUT_S = 60.0
DIED_RENDERING = Sentence(
    "worker-died-rendering-batch",
    "the worker process died {count} times while it rendered this batch",
    count=DEATHS_ALLOWED,
)
DIED_PREPARING_FRAME = Sentence(
    "worker-died-preparing-frame",
    "The worker process died {count} times while it prepared this frame.",
    count=DEATHS_ALLOWED,
)

log = logging.getLogger(__name__)


def register(app: Celery) -> None:
    """Registers the tasks with the Celery application."""
    tasks: dict[str, tuple[Callable[[Any, Any], None], str]] = {
        PREPARE: (_prepare, "prepare"),
        PREPARE_FRAMES: (_prepare_frames, "prepare frames"),
        RENDER_BATCH: (_render_batch, ""),
        RENDER_BATCHES: (_render_batches, ""),
        RENDER_JOINTLY: (_render_jointly, ""),
        RENDER_ON_CARD: (_render_on_card, "card"),
        HELP: (_help_with_piece, ""),
        DENOISE: (DENOISING, "denoise"),
        VECTORS: (MOTION_VECTORS, "vectors"),
        RENDER_VIEW: (_render_view, "view"),
        VIEW_FRAME: (_view_frame, "view frame"),
        DENOISE_VIEW: (_denoise_view, "denoise view"),
        ENVIRONMENT: (ENVIRONMENTS, "environment"),
        PATH_GUIDE: (PATH_GUIDES, "path guide"),
        EXPLAIN: (_explain, "explain"),
    }
    for name, (task, span) in tasks.items():
        app.task(traced_task(task, span, slot), name=name, bind=True)


def _render_batch(task: Any, batch: dict[str, Any]) -> None:
    """Renders a batch (RenderBatch.to_json) and sends its sums."""
    _render(task, context.current(), batch)


def _render_batches(task: Any, batches: list[dict[str, Any]]) -> None:
    """Renders batches one after another. Meanwhile threads send the previous batch's sums, and open the next one's scene.

    If the service recalls the message meanwhile, the batches that have not begun are returned.
    The task ends after all are sent, so the message of a killed slot is delivered again. A redelivered message may contain the
    batch that killed the slot: then each batch is sent before the next one begins.
    """
    worker, is_in_turn = context.current(), is_redelivered(task)
    recall = Recall(worker.results.redis, task.request.id)
    with SceneOpener(worker) as opener, SumsSender(every=recall.look) as sender:

        def begin(following: list[dict[str, Any]]) -> None:
            sender.begin()
            for each in following if not is_in_turn else ():
                if isinstance(each, dict):  # else the batch fails in its turn
                    opener.open(each.get("compiled"))

        for number, batch in enumerate(batches, 1):
            if recall.is_recalled:
                sender.wait()
                _return_recalled(worker, batches[number - 1 :])
                return
            with about(**message_ids(batch)):
                is_last = number == len(batches)  # sent at once, while the slot is still reported as busy with it
                submit = sender.send_now if is_in_turn or is_last else sender.submit
                if isinstance(batch, dict) and not is_mapped(batch.get("compiled")):
                    sender.begin_now()  # the slot waits for the scene, for minutes if it is downloaded
                _render(task, worker, batch, submit, partial(begin, batches[number : number + 1]))


def _return_recalled(worker: context.WorkerContext, batches: list[dict[str, Any]]) -> None:
    """Returns batches (RenderBatch.to_json) that have not begun to the service, which dispatches them again."""
    for batch in batches:
        try:
            work = RenderBatch.from_json(batch)
        except (RayfarmError, KeyError, TypeError, ValueError) as error:
            worker.results.send(unreadable_batch_event(worker, batch, error))
        else:
            worker.results.send(recalled_event(worker, work))


def _render(
    task: Any,
    worker: context.WorkerContext,
    batch: dict[str, Any],
    submit: Callable[[Send], None] = call,
    begins: Callable[[], None] = lambda: None,
) -> None:
    """Renders a batch, and sends its sums.

    submit: calls a function that packs and sends them, at once or later. begins: called before the kernel runs.
    """
    try:
        work = RenderBatch.from_json(batch)
    except (RayfarmError, KeyError, TypeError, ValueError) as error:
        worker.results.send(unreadable_batch_event(worker, batch, error))
        return
    with rendering_batch(worker, work, task.request.id) as do:
        deaths = count_deaths(task, worker, work.batch)
        if deaths >= DEATHS_ALLOWED:
            worker.results.send(failure_event(worker, work, DIED_RENDERING))
            return
        if deaths:
            with contextlib.suppress(TemporaryError):  # the slot's death may come from a file damaged on this disk
                discard_damaged(worker.cache, work.compiled)
        outcome = do(begins)

        def send() -> None:
            result = outcome.result()
            with step("send sums", slot=slot()):
                worker.results.send(result)
            reset_deaths(task, worker, work.batch)

        submit(send)


def _render_jointly(task: Any, joint: dict[str, Any]) -> None:
    """Renders one piece of a joint batch (JointBatch.to_json), and offers the other pieces to the slots of this worker."""
    worker = context.current()
    try:
        work = JointBatch.from_json(joint)
    except (RayfarmError, KeyError, TypeError, ValueError) as error:
        whole = joint.get("whole")
        worker.results.send(unreadable_batch_event(worker, whole if isinstance(whole, dict) else {}, error))
        return
    if not is_redelivered(task) and share_pieces(task.app, worker, work, task.request.id):
        render_waiting_piece(worker)
        return
    for number in remaining_pieces(worker, work, task.request.id):  # in turn: one of them may have killed the slot
        batch = work.batch(number).to_json()
        with about(**message_ids(batch)):
            _render(task, worker, batch)


def _render_on_card(task: Any, card: dict[str, Any]) -> None:
    """Renders batches (CardBatches.to_json) with this slot's graphics card, and sends the sums of each batch."""
    worker, message = context.current(), task.request.id
    try:
        work = CardBatches.from_json(card)
    except (RayfarmError, KeyError, TypeError, ValueError) as error:
        log.warning("batches for a graphics card cannot be parsed and are skipped: %s", error)
        return
    first = work.batches[0]

    def doing(batch: RenderBatch, tile: Tile) -> dict[str, Any]:
        about = {key: getattr(batch, key) for key in ("batch", "job", "frame", "first", "count")}
        return {**about, "tile": list(tile), "message": message}

    with SlotTask(worker, doing(first, first.tile)) as hand:

        def show(block: Block, is_compiling: bool) -> None:
            hand.report_part(doing(block.batches[0], block.tile) | ({"compiling": True} if is_compiling else {}))

        if count_deaths(task, worker, message) >= DEATHS_ALLOWED:
            return_to_cpus(worker, work.batches, DIED_RENDERING)
            return
        hand.speed = render_on_card(worker, work, show)
        reset_deaths(task, worker, message)


def _help_with_piece(task: Any, request: dict[str, Any]) -> None:
    """Renders a waiting piece of a joint batch of this worker, if there is one, and sends sums that are due.

    request: empty.
    """
    render_waiting_piece(context.current())


def _prepare(task: Any, scene: str) -> None:
    """Prepares an uploaded scene, and reports its progress. scene: the scene's id."""
    worker = context.current()
    about = {"scene": scene, "kind": worker.kind, "worker": worker.name}
    steps = Steps()

    def send(kind: str, **more: Any) -> None:
        worker.results.send(Result({"type": kind, **about, **more}))

    def progress(step: str, fraction: float) -> None:
        steps.begin_step(step)
        worker.results.send(Result({"type": "prepare-progress", **about, "step": step, "fraction": fraction}), 0.0)

    def send_preview(preview: ScenePreview) -> None:
        said = {"step": "reading", "fraction": 0.3, "preview": asdict(preview)}
        worker.results.send(Result({"type": "prepare-progress", **about, **said}), 0.0)

    with SlotTask(worker, {"scene": scene}):
        info: SceneInfo | None = None
        try:
            if count_deaths(task, worker, scene) >= DEATHS_ALLOWED:
                send(
                    "prepare-failed",
                    error=Sentence(
                        "worker-died-preparing-scene",
                        "The worker process died {count} times while it prepared this scene.",
                        count=DEATHS_ALLOWED,
                    ),
                )
                return
            send("prepare-started")
            manifest = retry_temporary(lambda: worker.link.manifest(scene), LINK_TIMEOUT_S)
            info = retry_temporary(lambda: prepare_scene(worker, manifest, progress, send_preview), LINK_TIMEOUT_S)
            steps.begin_step(None)
            send("prepared", info=asdict(info))
        except Exception as error:
            kind, fields = _scene_failure(worker, scene, error)
            send(kind, **fields)
        if info is not None and manifest.base is None:  # a relit scene is shown by its base's thumbnail
            _send_thumbnail(worker, about, info, manifest.main)


def _scene_failure(worker: context.WorkerContext, scene: str, error: Exception) -> tuple[str, dict[str, Any]]:
    """Returns the type and the fields of the event that reports why a scene is not prepared. Logs an unexpected error."""
    match error:
        case WorkError():
            return "prepare-failed", {"error": str(error)}
        case MachineError():
            return "prepare-returned", {"error": str(error), "unfit": True, "passing": True}
        case TemporaryError():
            said = Sentence("worker-returned-scene", "{worker} returned the scene: {error}", worker=worker.name, error=error)
            return "prepare-returned", {"error": said}
        case UnfitError():
            return "prepare-returned", {"error": str(error), "unfit": True}
        case RefusedError():
            said = Sentence(
                "worker-file-transfer-failed",
                "{worker} could not exchange the scene's files with the service: {error}",
                worker=worker.name,
                error=error,
            )
            return "prepare-failed", {"error": said}
    log.error("preparing %s failed", scene, exc_info=error)
    said = Sentence(
        "worker-scene-failed",
        "{worker} could not prepare the scene ({kind}: {error}).",
        worker=worker.name,
        kind=type(error).__name__,
        error=error,
    )
    return "prepare-failed", {"error": said}


def _send_thumbnail(worker: context.WorkerContext, about: dict[str, Any], info: SceneInfo, main: str) -> None:
    """Renders and reports the thumbnail of a prepared scene, whose jobs may already run. If it fails, there is no thumbnail.

    about: fields of the event. main: name of the scene's main file.
    """
    try:
        made = make_thumbnail(worker, info, main)
    except (WorkerError, OSError) as error:
        log.warning("no thumbnail of scene %s: %s", about["scene"], error)
    else:
        worker.results.send(Result({"type": "thumbnail-made", **about, "thumbnail": asdict(made)}))


def _prepare_frames(task: Any, frames: dict[str, Any]) -> None:
    """Prepares frames of a shot (PrepareFrames as a dict), and sends an answer for each."""
    worker = context.current()
    about = {name: frames.get(name) for name in ("work", "job")} | {"kind": worker.kind, "worker": worker.name}

    def send(kind: str, **more: Any) -> None:
        worker.results.send(Result({"type": kind, **about, **more}))

    try:
        work = PrepareFrames.from_json(frames)
    except ValueError as error:
        send(
            "frames-returned",
            error=Sentence(
                "worker-frames-request-unreadable",
                "{worker} cannot read which frames to prepare ({error}).",
                worker=worker.name,
                error=error,
            ),
        )
        return
    with SlotTask(worker, {"scene": work.scene, "work": work.work}):
        try:
            if count_deaths(task, worker, work.work) >= DEATHS_ALLOWED:
                send("frame-failed", frame=work.frames[0], error=DIED_PREPARING_FRAME)
                send("frames-returned", error=DIED_PREPARING_FRAME)
                return
            manifest = retry_temporary(lambda: worker.link.manifest(work.scene), LINK_TIMEOUT_S)
            prepare_frames(worker, manifest, work, send)
        except MachineError as error:
            send("frames-returned", error=str(error), unfit=True, passing=True)
        except TemporaryError as error:
            send(
                "frames-returned",
                error=Sentence("worker-returned-frames", "{worker} returned frames: {error}", worker=worker.name, error=error),
            )
        except UnfitError as error:
            send("frames-returned", error=str(error), unfit=True)
        except Exception as error:
            log.exception("preparing frames of %s failed", work.scene)
            for frame in work.frames:
                why = Sentence(
                    "worker-preparation-failed",
                    "{worker} could not prepare it ({kind}: {error}).",
                    worker=worker.name,
                    kind=type(error).__name__,
                    error=error,
                )
                send("frame-failed", frame=frame, error=why)


def _render_view(task: Any, parts: dict[str, Any]) -> None:
    """Renders parts of a live view (ViewParts.to_json), and sends the sums of each part."""
    worker = context.current()
    try:
        work = ViewParts.from_json(parts)
    except (RayfarmError, KeyError, TypeError, ValueError) as error:
        log.warning("a view cannot be parsed and is skipped: %s", error)
        return
    with SlotTask(worker, {"view": work.watch, "message": work.message}) as hand:
        if count_deaths(task, worker, work.message) >= DEATHS_ALLOWED:
            sentence = Sentence(
                "worker-died-rendering-view",
                "The worker process died {count} times while it rendered this view.",
                count=DEATHS_ALLOWED,
            )
            ViewAnswers(worker, work).send("declined" if work.on_card else "failed", error=sentence)
        else:
            render = render_view_on_card if work.on_card else render_view
            hand.speed = render(worker, work, hand.report_compiling)


def _view_frame(task: Any, frame: dict[str, Any]) -> None:
    """Prepares animation frames for a live view (ViewFrame.to_json)."""
    worker = context.current()
    try:
        work = ViewFrame.from_json(frame)
    except (KeyError, TypeError, ValueError) as error:
        log.warning("a frame of a view cannot be parsed and is skipped: %s", error)
        return
    with SlotTask(worker, {"view": work.watch, "message": work.message}):
        if count_deaths(task, worker, work.message) >= DEATHS_ALLOWED:
            ViewAnswers(worker, work).send("failed", error=DIED_PREPARING_FRAME)
        else:
            prepare_view_frame(worker, work)


def _denoise_view(task: Any, picture: dict[str, Any]) -> None:
    """Denoises the picture of a live view (ViewDenoise.to_json)."""
    worker = context.current()
    try:
        work = ViewDenoise.from_json(picture)
    except (KeyError, TypeError, ValueError) as error:
        log.warning("a view's picture cannot be parsed and is skipped: %s", error)
        return
    with SlotTask(worker, {"view": work.watch, "message": work.message}):
        if not count_deaths(task, worker, work.message):  # after a death the service sends a later picture
            denoise_view(worker, work)


def _explain(task: Any, pixel: dict[str, Any]) -> None:
    """Explains the colour of a pixel (ExplainPixel.to_json): traces paths of its samples, and sends them to the service."""
    worker = context.current()
    try:
        work = ExplainPixel.from_json(pixel)
    except (RayfarmError, KeyError, TypeError, ValueError) as error:
        sentence = Sentence(
            "worker-request-unreadable",
            "{worker} cannot read the request ({error}). Run the same release of Rayfarm on all machines.",
            worker=worker.name,
            error=error,
        )
        send_answer(worker, str(pixel.get("message")), "failed", error=sentence)
        return
    with SlotTask(worker, {"explain": work.job, "message": work.message}) as hand:
        if not count_deaths(task, worker, work.message):  # after a death the client has already got an error
            explain_pixel(worker, work, hand.report_compiling)
