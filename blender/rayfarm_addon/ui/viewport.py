"""The viewport in "rendered" mode: exports changes for a few milliseconds at a time, and draws the farm's newest image."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..farm.client import FarmError
from ..farm.watching import LiveView, ViewPicture
from ..scene.cameras import lens_of
from ..scene.files import MAIN, scene_files
from ..scene.gather import ExportedMeshes, export_scene
from ..scene.view import Lens, shot_of
from . import connection
from .drawing import Canvas
from .picture import light_of, requested

__all__ = ["PendingChanges", "Viewport"]

TICK_S = 0.015  # duration of one export step in the main thread
LOOK_S = 0.05
HIDDEN_DEPTH = 1000.0
SETTLED_S = 0.15  # pause after the last change before an export, so that not every step of a drag is sent


class PendingChanges:
    """The changes in Blender's data since the last export."""

    def __init__(self) -> None:
        self.all = True
        self.names: set[tuple[str, str]] = set()  # of objects and their data whose meshes have changed

    def record_updates(self, depsgraph: Any) -> bool:
        """Records the updates of the dependency graph; returns True if the scene must be exported again."""
        matters = self.all
        for update in depsgraph.updates:
            id = update.id
            kind = type(id).__name__
            if kind in ("Object", "Mesh", "Curve", "MetaBall", "TextCurve", "SurfaceCurve") and update.is_updated_geometry:
                self.names.add((kind, id.name_full))
            is_camera = kind == "Camera" or (kind == "Object" and id.type == "CAMERA")
            matters = matters or kind == "Collection" or not (is_camera or (kind == "Scene" and not _is_any_updated(update)))
        return matters

    def needs_export(self, thing: Any, data: Any) -> bool:
        """Returns True if an object's mesh has changed since the last export. thing: the object; data: its mesh."""
        if self.all or thing.is_from_instancer:
            return self.all or bool(self.names)
        told = {("Object", thing.name_full)}
        if data is not None:
            told.add((type(data).__name__, data.name_full))
        return not told.isdisjoint(self.names)

    def clear_changes(self) -> None:
        """Clears the recorded changes, after they were exported."""
        self.all = False
        self.names.clear()


def _is_any_updated(update: Any) -> bool:
    return bool(update.is_updated_geometry or update.is_updated_transform or update.is_updated_shading)


class Viewport:
    """The state of one viewport in "rendered" mode; exists as long as its engine."""

    def __init__(self, engine: Any, url: str, token: str, project: str, title: str) -> None:
        self._engine = engine
        self._error = ""
        self._watching: LiveView | None = None
        try:
            farm = connection.connect(url, token, project)
            self._watching = LiveView(farm.client, farm.uploads, title)
        except FarmError as error:
            self._error = str(error)
        self._known: ExportedMeshes = {}
        self._changes = PendingChanges()
        self._reading: Iterator[Any] | None = None
        self._begin_at = 0.0  # earliest time of the next export
        self._waits = False
        self._asked: dict[str, Any] | None = None
        self._shots: dict[int, Any] = {}
        self._canvas = Canvas()
        self._start_timer()

    def _start_timer(self) -> None:
        import bpy

        self._ticking = self.tick  # Blender identifies a timer by its object, and each access to a bound method creates a new one
        bpy.app.timers.register(self._ticking, first_interval=LOOK_S)

    def tick(self) -> float | None:
        """Requests a redraw if there is something to draw or to export.

        Returns seconds to the next call, or None to end the timer. Called by Blender's timer.
        """
        watching = self._watching
        if watching is None:
            return None
        if watching.is_fresh.is_set() or self._reading is not None or self._waits:
            watching.is_fresh.clear()
            try:
                self._engine.tag_redraw()
            except ReferenceError:
                self.close()
                return None
        return LOOK_S

    def update(self, depsgraph: Any) -> None:
        """Schedules an export, which begins once no further changes arrive for a while."""
        if self._changes.record_updates(depsgraph):
            self._reading, self._waits = None, True
            self._begin_at = 0.0 if not self._known else time.monotonic() + SETTLED_S

    def read(self, depsgraph: Any) -> None:
        """Continues the export of the scene for a few milliseconds."""
        if self._watching is None:
            return
        now = time.monotonic()
        if self._waits and now >= self._begin_at:
            self._waits = False
            self._reading = export_scene(depsgraph, self._known, self._changes.needs_export)
        if self._reading is None:
            return
        found = None
        for step in self._reading:
            found = step
            if time.monotonic() - now > TICK_S:
                return
        self._reading = None
        self._changes.clear_changes()
        if found is not None:
            connection.store_warnings(found.scene.warnings)
            try:
                self._watching.set_scene(scene_files(found.scene), MAIN, light_of(found.scene.world))
            except ValueError as error:
                self._error = str(error)
            else:
                self._error = ""

    def send_view(self, context: Any, depsgraph: Any) -> None:
        """Sends the viewport's view to the farm if it has changed."""
        if self._watching is None:
            return
        region, space = context.region, context.space_data
        seen = context.region_data
        place = np.array(seen.view_matrix.inverted(), np.float64)
        projection = np.array(seen.window_matrix, np.float64)
        if projection[3, 3] != 0 and seen.view_perspective != "CAMERA":
            # An orthographic view in Blender also shows objects behind the eye.
            place[:3, 3] += place[:3, 2] * min(float(space.clip_end), HIDDEN_DEPTH)
        camera = space.camera if seen.view_perspective == "CAMERA" else None
        lens = Lens() if camera is None or camera.type != "CAMERA" else lens_of(None, camera.evaluated_get(depsgraph))
        try:
            shot = shot_of(place, projection, (region.width, region.height), lens)
        except ValueError as error:
            self._error = str(error)
            return
        asked = requested(depsgraph.scene, depsgraph.scene.rayfarm.view_samples)
        asked |= {"view": shot.view, "width": shot.width, "height": shot.height}
        if asked != self._asked:
            self._asked = asked
            number = self._watching.set_view(asked)
            self._shots = {n: s for n, s in self._shots.items() if n > number - 64}
            self._shots[number] = shot

    def draw(self, context: Any, depsgraph: Any) -> None:
        """Draws the newest image and a status line in the viewport."""
        self.read(depsgraph)
        self.send_view(context, depsgraph)
        text = self._error
        if self._watching is not None:
            shown, said = self._watching.picture_and_status
            text = text or ("Reading the scene" if self._reading is not None else said)
            if shown is not None:
                self._canvas.set_picture(shown, self.visible_part(shown))
        self._engine.update_stats("Rayfarm", text)
        self._canvas.draw(self._engine, depsgraph.scene, context.region)

    def visible_part(self, picture: ViewPicture) -> tuple[float, float, float, float]:
        """Returns the part of an image that the viewport shows: left, low, right, high as fractions from the lower left."""
        shot = self._shots.get(picture.id)
        if shot is None:
            return 0.0, 0.0, 1.0, 1.0
        low = shot.height - shot.y - shot.h
        left, right = shot.x / shot.width, (shot.x + shot.w) / shot.width
        return left, low / shot.height, right, (low + shot.h) / shot.height

    def close(self) -> None:
        """Ends the live view."""
        if self._watching is not None:
            self._watching.close()
            self._watching = None
        with contextlib.suppress(Exception):
            import bpy

            if bpy.app.timers.is_registered(self._ticking):
                bpy.app.timers.unregister(self._ticking)
