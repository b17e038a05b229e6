"""Explains a pixel: renders its samples again with the settings of its job, and traces the paths of a few of them."""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Callable
from functools import partial
from typing import Any

import redis

from protocol.explained import ANSWER_TTL_S, ExplainPixel, explained_key
from renderer.errors import RayfarmError
from renderer.pixel_paths import MODELS, PixelPath, PixelPaths, bounce_of, pixel_paths
from renderer.render import is_warm, settings_as_rendered, variant_for
from renderer.replay import LightSample, Vertex
from renderer.scene.compiled import CompiledScene
from renderer.sentences import Sentence, encoded
from worker.exchange.errors import MachineError, RefusedError, TemporaryError, UnfitError
from worker.exchange.ready import make_kernel_ready, pilot_readiness
from worker.exchange.retry import retry_temporary
from worker.process.context import WorkerContext
from worker.work.frames import compiled_frame
from worker.work.open_scenes import mapped_scene
from worker.work.scenes import scene_not_fetched

__all__ = ["explain_pixel", "explanation_json", "send_answer"]

PATIENCE_S = 5.0  # seconds to retry an unreachable service; a client waits

log = logging.getLogger(__name__)


def send_answer(worker: WorkerContext, message: str, type: str, **more: Any) -> None:
    """Appends an answer of this type to a message's list in Redis. If Redis is unreachable, only logs that.

    more: further fields of the answer.
    """
    try:
        with worker.results.redis.pipeline(transaction=False) as at_once:
            at_once.rpush(explained_key(message), json.dumps(encoded({"type": type, "worker": worker.name, **more})))
            at_once.expire(explained_key(message), ANSWER_TTL_S)
            at_once.execute()
    except (redis.RedisError, OSError) as error:
        log.warning("an explanation is lost: %s", error)


def explain_pixel(worker: WorkerContext, work: ExplainPixel, compiling: Callable[[bool], None]) -> None:
    """Renders a pixel's samples again, traces some of their paths, and sends the answer.

    compiling: called with True before the scene's kernel is made ready, and with False afterwards.
    """
    answer = partial(send_answer, worker, work.message)
    answer("begun")
    try:
        scene = _open_scene(worker, work)
        variant = variant_for(work.settings, scene)
        kernel = settings_as_rendered(work.settings, scene, pilot_readiness(worker.link, compiling))
        if not is_warm(kernel, variant):
            compiling(True)
            answer("compiling")
            make_kernel_ready(worker.link, kernel, variant)
            compiling(False)
        found = pixel_paths(scene, work.settings, work.x, work.y, work.count, work.sample)
        answer("done", explained=explanation_json(scene, found))
    except (UnfitError, MachineError) as error:
        answer("returned", error=str(error), unfit=True)
    except TemporaryError as error:
        said = Sentence("worker-returned-request", "{worker} returned the request: {error}", worker=worker.name, error=error)
        answer("returned", error=said)
    except RefusedError as error:
        answer("failed", error=scene_not_fetched(worker, error))
    except RayfarmError as error:
        answer("failed", error=str(error))
    except MemoryError:
        answer("returned", error=Sentence("scene-memory-exhausted", "there is too little memory for this scene"), unfit=True)
    except Exception as error:  # any error fails this pixel only, not the worker
        log.exception("explaining a pixel of job %s failed", work.job)
        said = Sentence(
            "worker-paths-failed",
            "{worker} could not trace its paths ({kind}: {error})",
            worker=worker.name,
            kind=type(error).__name__,
            error=error,
        )
        answer("failed", error=said)


def _open_scene(worker: WorkerContext, work: ExplainPixel) -> CompiledScene:
    if work.moment is not None:
        moment = work.moment
        manifest = retry_temporary(lambda: worker.link.manifest(moment.scene), PATIENCE_S)
        found = compiled_frame(worker, manifest, moment)
        if found is not None:
            return found
    return retry_temporary(lambda: mapped_scene(worker, work.compiled), PATIENCE_S)


def explanation_json(scene: CompiledScene, found: PixelPaths) -> dict[str, Any]:
    """Returns the traced paths as JSON data for the client. Numbers that are not finite become null."""
    paths = [_path(scene, path) for path in found.paths]
    return {"samples": found.samples, "sums": list(found.sums), "finite": found.finite, "paths": paths}


def _path(scene: CompiledScene, path: PixelPath) -> dict[str, Any]:
    vertices = path.replay.vertices
    following = [*vertices[1:], None]
    lines = [
        _vertex_json(scene, vertex, beyond) | {"spot": list(spot), "light": vertex.lamp and _lamp_json(vertex.lamp, lamp)}
        for vertex, beyond, spot, lamp in zip(vertices, following, path.spots, path.lamps, strict=True)
    ]
    value = path.replay.value
    about = {"chosen": path.chosen, "sample": path.sample, "value": value and list(value), "end": path.replay.end}
    return {**about, "time": path.replay.time, "vertices": lines}


def _vertex_json(scene: CompiledScene, vertex: Vertex, beyond: Vertex | None) -> dict[str, Any]:
    model = None if vertex.material is None else MODELS.get(int(scene.material_kind[vertex.material]))
    return {
        **{name: getattr(vertex, name) for name in ("kind", "object", "material", "survival")},
        "distance": _number(vertex.distance),
        "point": vertex.point and _numbers(vertex.point),
        "normal": vertex.normal and _numbers(vertex.normal),
        "direction": _numbers(vertex.direction),
        "throughput": _numbers(vertex.throughput),
        "emitted": _numbers(vertex.emitted),
        "emitted_weight": vertex.share,
        "direct": _numbers(vertex.direct),
        "beside": _numbers(vertex.beside),
        "model": model,
        "bounce": bounce_of(vertex, beyond),
        "pdf": beyond and beyond.pdf and _number(beyond.pdf),
    }


def _lamp_json(lamp: LightSample, spot: Any) -> dict[str, Any]:
    return {
        "point": lamp.point and _numbers(lamp.point),
        "direction": _numbers(lamp.direction),
        "pdf": _number(lamp.pdf),
        "weight": lamp.share,
        "brought": _numbers(lamp.brought),
        "spot": list(spot),
    }


def _numbers(values: Any) -> list[float | None]:
    return [_number(value) for value in values]


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
