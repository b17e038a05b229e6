"""The render engine: F12 and Ctrl-F12 submit jobs to the farm and show their tiles in Blender's image editor."""

from __future__ import annotations

import queue
import time
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..farm.client import FarmError
from ..farm.packets import rgba
from ..farm.protocol import rgbe9995
from ..farm.render_request import Failed, FinishedPicture, StatusMessage, TileUpdate
from ..farm.rendering import Rendering
from . import connection
from .passes import COMBINED, enabled_passes, planes_of, values
from .picture import Picture, frame_and_subframe, picture_of
from .settings import farm_of
from .viewport import Viewport

__all__ = ["RayfarmEngine"]

TICK_S = 0.05
PATIENCE_S = 5.0  # timeout for cancelling a job on the farm


class RayfarmEngine(bpy.types.RenderEngine):
    """Blender's render engine "Rayfarm", which renders images and viewports on a farm."""

    bl_idname = "RAYFARM"
    bl_label = "Rayfarm"
    bl_use_preview = False
    bl_use_postprocess = True
    bl_use_shading_nodes_custom = False
    bl_use_eevee_viewport = True
    bl_use_gpu_context = False

    _viewport: Viewport | None = None

    def update_render_passes(self, scene: Any = None, renderlayer: Any = None) -> None:
        """Registers the render passes with Blender."""
        for each in (COMBINED, *enabled_passes(scene, renderlayer)):
            self.register_pass(scene, renderlayer, each.name, len(each.ids), each.ids, each.kind)

    def render(self, depsgraph: Any) -> None:
        """Renders an image; called by Blender in a thread that may block."""
        try:
            self._render(depsgraph)
        except (FarmError, ValueError) as error:
            self._report_error(str(error))

    def _render(self, depsgraph: Any) -> None:
        scene, layer = depsgraph.scene, depsgraph.view_layer
        passes = enabled_passes(scene, layer)
        self.update_stats("", "Rayfarm: reading the scene")
        connection.store_warnings([])
        picture = picture_of(depsgraph, self._camera_matrix, self._go_to, planes_of(passes), _title(scene, layer))
        farm = connection.connect(*farm_of(bpy.context), scene.rayfarm.project)
        connection.store_warnings(picture.warnings)
        for sentence in picture.warnings:
            self.report({"WARNING"}, sentence)
        rendering = Rendering(farm.client, farm.uploads, picture.asked)
        self._follow(rendering, picture, layer.name, passes)

    def _camera_matrix(self, camera: Any) -> Any:
        return np.array(self.camera_model_matrix(camera), np.float64)

    def _go_to(self, frame: float) -> None:
        self.frame_set(*frame_and_subframe(frame))

    def _is_cancelled(self) -> bool:
        return bool(self.test_break())

    def _follow(self, rendering: Rendering, picture: Picture, layer: str, passes: list[Any]) -> None:
        cancelled = 0.0  # time of the cancellation
        while not cancelled or time.monotonic() < cancelled + PATIENCE_S:
            if not cancelled and self._is_cancelled():
                cancelled = time.monotonic()
                rendering.cancel()
            try:
                event = rendering.events.get(timeout=TICK_S)
            except queue.Empty:
                continue
            if isinstance(event, StatusMessage):
                self.update_stats("", f"Rayfarm: {event.text}")
                if event.progress is not None:
                    self.update_progress(event.progress)
            elif isinstance(event, TileUpdate):
                if not cancelled:
                    self._copy_tile(event, picture, layer)
            elif isinstance(event, Failed):
                if event.sentence is not None:
                    self._report_error(event.sentence)
                return
            else:
                self._finish(event, picture, layer, passes)
                return

    def _copy_tile(self, tile: TileUpdate, picture: Picture, layer: str) -> None:
        """Copies the needed part of a tile to the pixels of a render layer. picture: the request with the needed part."""
        shot = picture.shot
        h, w = tile.words.shape
        x0, x1 = max(tile.x, shot.x), min(tile.x + w, shot.x + shot.w)
        y0, y1 = max(tile.y, shot.y), min(tile.y + h, shot.y + shot.h)
        if x0 >= x1 or y0 >= y1:
            return
        words = tile.words[y0 - tile.y : y1 - tile.y, x0 - tile.x : x1 - tile.x]
        result = self.begin_result(x0 - shot.x, shot.y + shot.h - y1, x1 - x0, y1 - y0, layer=layer)
        if result is None or not result.layers:
            return
        _fill_pass(result, "Combined", rgba(rgbe9995.unpack(words)).reshape(-1, 4))
        self.end_result(result)

    def _finish(self, finished: FinishedPicture, picture: Picture, layer: str, passes: list[Any]) -> None:
        shot = picture.shot
        result = self.begin_result(0, 0, shot.w, shot.h, layer=layer)
        for each in (COMBINED, *passes):
            _fill_pass(result, each.name, values(each, finished.channels, shot, picture.ids))
        self.end_result(result)
        theirs = [sentence for sentence in finished.warnings if sentence not in picture.warnings]
        connection.store_warnings([*picture.warnings, *theirs])
        for sentence in theirs:
            self.report({"WARNING"}, sentence)
        self.update_stats("", f"Rayfarm: done, {finished.sent_bytes / 1e6:.1f} MB were sent")

    def _report_error(self, sentence: str) -> None:
        self.report({"ERROR"}, sentence)
        self.error_set(sentence)

    def view_update(self, context: Any, depsgraph: Any) -> None:
        """Schedules an export; called by Blender when something shown in the viewport has changed."""
        self._viewport_of(context, depsgraph).update(depsgraph)

    def view_draw(self, context: Any, depsgraph: Any) -> None:
        """Draws the newest image and continues the export; called by Blender."""
        self._viewport_of(context, depsgraph).draw(context, depsgraph)

    def _viewport_of(self, context: Any, depsgraph: Any) -> Viewport:
        if self._viewport is None:
            url, token = farm_of(context)
            self._viewport = Viewport(self, url, token, depsgraph.scene.rayfarm.project, _file_name())
        return self._viewport

    def __del__(self) -> None:
        viewport = getattr(self, "_viewport", None)
        if viewport is not None:
            viewport.end()
        ends = getattr(super(), "__del__", None)  # since Blender 4.4
        if ends is not None:
            ends()


def _fill_pass(result: Any, name: str, flat: Any) -> None:
    found = next((each for each in result.layers[0].passes if each.name == name), None)
    if found is None:
        return
    try:
        found.rect.foreach_set(np.ascontiguousarray(flat, np.float32).ravel())
    except (AttributeError, TypeError):
        found.rect = flat.tolist()


def _file_name() -> str:
    return Path(bpy.data.filepath).stem or "Blender"


def _title(scene: Any, layer: Any) -> str:
    more = f", {layer.name}" if len(scene.view_layers) > 1 else ""
    return f"{_file_name()}, frame {scene.frame_current}{more}"[:200]
