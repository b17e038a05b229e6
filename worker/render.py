"""Render a batch: map the compiled scene, let the kernel sum the samples, send the sums back."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Any

from renderer.errors import RayfarmError
from renderer.render import is_warm, render_batch, warm_up
from renderer.scene.compiled import CompiledScene, load
from worker.context import WorkerContext
from worker.contract import RenderBatch, Result, pack_sums
from worker.link import LinkError, RefusedError
from worker.reproduce import batch_command

__all__ = ["batch_event", "failure", "render"]

# Mapped scenes that a slot keeps open. They cost address space; their pages are shared with every other slot.
OPEN_SCENES = 8

_open: OrderedDict[str, CompiledScene] = OrderedDict()


def render(worker: WorkerContext, batch: RenderBatch, compiling: Callable[[bool], None]) -> Result:
    """The batch's exact sums, or the reason why there are none. compiling: told when a rare kernel is got ready, and is."""
    try:
        if not is_warm(batch.settings):
            compiling(True)
            warm_up(batch.settings)
            compiling(False)
        begun = time.perf_counter()
        scene = _scene(worker, batch.compiled)
        sums = render_batch(scene, batch.settings, batch.tile, batch.first, batch.count)
    except (LinkError, RefusedError) as error:
        return failure(worker, batch, f"{worker.name} cannot fetch the scene: {error}")
    except RayfarmError as error:
        return failure(worker, batch, str(error))
    except MemoryError:
        return failure(worker, batch, f"{worker.name} has too little memory for this scene")
    except Exception as error:  # whatever it is, it is this batch's fault and not the worker's end
        return failure(worker, batch, f"{type(error).__name__}: {error}")
    event = {
        **batch_event(worker, batch, "batch"),
        "seconds": time.perf_counter() - begun,
        "bad": [list(bad) for bad in sums.bad],
        "bad_count": sums.bad_count,
    }
    return Result(event, pack_sums(sums.sums))


def failure(worker: WorkerContext, batch: RenderBatch, error: str) -> Result:
    """The event of a batch that could not be rendered."""
    command = batch_command(batch.settings, batch.tile, batch.first, batch.count)
    return Result({**batch_event(worker, batch, "batch-failed"), "error": error, "reproduce": command})


def batch_event(worker: WorkerContext, batch: RenderBatch, kind: str) -> dict[str, Any]:
    """What every event about a batch says."""
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


def _scene(worker: WorkerContext, sha256: str) -> CompiledScene:
    """The compiled scene, mapped once per slot."""
    scene = _open.get(sha256)
    if scene is None:
        scene = load(worker.cache.path(sha256))
        _open[sha256] = scene
        if len(_open) > OPEN_SCENES:
            _open.popitem(last=False)
    _open.move_to_end(sha256)
    return scene
