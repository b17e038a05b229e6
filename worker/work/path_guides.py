"""Path guides: one slot of the farm trains the guide of a frame and stores it as a blob, and the others read it.

A guide is a function of the compiled scene and the settings, so a slot that cannot read it trains it again.
"""

from __future__ import annotations

import logging
import tempfile
from pathlib import Path
from typing import Any

from protocol.contract import TrainPathGuide
from renderer import jit
from renderer.guiding.stored_guide import read_guide, write_guide
from renderer.guiding.train import is_guide_kept, keep_guide
from renderer.kernel.accumulate import samples_guide
from renderer.render import guide_of
from renderer.scene.compiled import CompiledScene
from renderer.sentences import Sentence
from renderer.settings import RenderSettings
from worker.exchange.errors import UnfitError, WorkerError
from worker.exchange.ready import make_pilot_ready
from worker.exchange.retry import retry_temporary
from worker.process.context import WorkerContext
from worker.work.open_scenes import mapped_scene
from worker.work.scenes import store

__all__ = ["train_frame_guide", "use_stored_guide"]

PATIENCE_S = 30.0

log = logging.getLogger(__name__)


def train_frame_guide(worker: WorkerContext, work: TrainPathGuide) -> dict[str, Any]:
    """Trains a frame's guide, and returns its blob. Raises WorkerError and OSError."""
    if work.kind != jit.kind():
        raise UnfitError(Sentence("guide-other-release", "this machine has another release of the renderer"))
    scene = retry_temporary(lambda: mapped_scene(worker, work.compiled), PATIENCE_S)
    guide = None
    if samples_guide(work.settings):
        guide = guide_of(work.settings, scene, lambda settings, variant: make_pilot_ready(worker.link, settings, variant))
    with tempfile.TemporaryDirectory(prefix="rayfarm-guide-") as folder:
        path = Path(folder) / "guide"
        path.write_bytes(write_guide(guide))
        ref = store(worker, path)
        worker.cache.add_copy(path, ref.sha256)
    return {"sha256": ref.sha256}


def use_stored_guide(worker: WorkerContext, scene: CompiledScene, settings: RenderSettings, sha256: str) -> None:
    """Reads the guide of an image, so that it is not trained here; does nothing if it cannot be read.

    sha256: of its blob; "" if there is none.
    """
    if not sha256 or is_guide_kept(scene, settings):
        return
    try:
        keep_guide(scene, settings, read_guide(worker.cache.path(sha256).read_bytes()))
    except (WorkerError, OSError, ValueError) as error:
        log.info("a guide is trained here, since it cannot be read: %s", error)
