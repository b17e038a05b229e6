"""The panels in the render properties, and the button that tests the connection."""

from __future__ import annotations

import threading
from typing import Any

import bpy

from ..farm.client import Client, FarmError
from . import connection
from .engine import RayfarmEngine
from .settings import farm_of, package

__all__ = ["CLASSES"]

LOOK_S = 0.1


class RAYFARM_OT_test_connection(bpy.types.Operator):
    """Tests whether the farm accepts the token, and shows how many workers it has"""

    bl_idname = "rayfarm.test_connection"
    bl_label = "Test Connection"

    _thread: threading.Thread | None = None
    _timer: Any = None

    def execute(self, context: Any) -> set[str]:
        """Tests the connection and waits for the response; called from scripts."""
        self._check_connection(*farm_of(context))
        return self._report_answer()

    def invoke(self, context: Any, event: Any) -> set[str]:
        """Tests the connection in a thread, so that Blender's window stays responsive; called when the button is clicked."""
        self._thread = threading.Thread(target=self._check_connection, args=farm_of(context), daemon=True)
        self._thread.start()
        self._timer = context.window_manager.event_timer_add(LOOK_S, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: Any, event: Any) -> set[str]:
        """Checks whether the response has arrived; called by Blender's timer."""
        if event.type != "TIMER" or self._thread is None or self._thread.is_alive():
            return {"PASS_THROUGH"}
        context.window_manager.event_timer_remove(self._timer)
        return self._report_answer()

    def _check_connection(self, url: str, token: str) -> None:
        self._answer: tuple[bool, str]
        try:
            self._answer = True, Client(url, token).check()
        except FarmError as error:
            self._answer = False, str(error)

    def _report_answer(self) -> set[str]:
        good, sentence = self._answer
        self.report({"INFO"} if good else {"ERROR"}, sentence)
        return {"FINISHED"} if good else {"CANCELLED"}


class _Panel:
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"
    COMPAT_ENGINES = {RayfarmEngine.bl_idname}  # noqa: RUF012 -- so Blender wants it

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Returns True if the scene's engine is Rayfarm."""
        return context.scene.render.engine in cls.COMPAT_ENGINES


class RAYFARM_PT_farm(_Panel, bpy.types.Panel):
    """The panel with the farm's address and job settings."""

    bl_label = "Farm"

    def draw(self, context: Any) -> None:
        """Draws the panel; called by Blender."""
        column = self.layout.column()
        column.use_property_split = True
        column.use_property_decorate = False
        known = context.preferences.addons.get(package())
        if known is not None and known.preferences is not None:
            column.prop(known.preferences, "url")
            column.prop(known.preferences, "token")
        column.prop(context.scene.rayfarm, "project")
        column.prop(context.scene.rayfarm, "priority")
        column.operator("rayfarm.test_connection", icon="LINKED")


class RAYFARM_PT_sampling(_Panel, bpy.types.Panel):
    """The panel with the quality settings: samples, noise level, path depth."""

    bl_label = "Sampling"

    def draw(self, context: Any) -> None:
        """Draws the panel; called by Blender."""
        settings = context.scene.rayfarm
        column = self.layout.column()
        column.use_property_split = True
        column.use_property_decorate = False
        column.prop(settings, "samples")
        row = column.row(heading="Noise Level")
        row.prop(settings, "use_noise", text="")
        sub = row.row()
        sub.active = settings.use_noise
        sub.prop(settings, "noise", text="")
        column.prop(settings, "view_samples")
        column.prop(settings, "depth")
        column.prop(settings, "clamp")
        column.prop(settings, "seed")
        column.prop(settings, "filter")
        column.prop(settings, "denoise")


class RAYFARM_PT_motion_blur(_Panel, bpy.types.Panel):
    """The panel with Blender's own motion blur settings."""

    bl_label = "Motion Blur"
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012 -- so Blender wants it

    def draw_header(self, context: Any) -> None:
        """Draws the check box in front of the panel's name."""
        self.layout.prop(context.scene.render, "use_motion_blur", text="")

    def draw(self, context: Any) -> None:
        """Draws the panel; called by Blender."""
        render = context.scene.render
        column = self.layout.column()
        column.use_property_split = True
        column.active = render.use_motion_blur
        column.prop(render, "motion_blur_position", text="Position")
        column.prop(render, "motion_blur_shutter")
        column.prop(context.scene.rayfarm, "keys")
        if (cycles := getattr(context.scene, "cycles", None)) is not None:
            column.prop(cycles, "rolling_shutter_type")
            duration = column.column()
            duration.active = cycles.rolling_shutter_type != "NONE"
            duration.prop(cycles, "rolling_shutter_duration", text="Row Exposure")


class RAYFARM_PT_notes(_Panel, bpy.types.Panel):
    """The panel with the warnings about differences from Blender."""

    bl_label = "Differences from Blender"

    @classmethod
    def poll(cls, context: Any) -> bool:
        """Returns True if there are warnings."""
        return context.scene.render.engine in cls.COMPAT_ENGINES and bool(connection.notes())

    def draw(self, context: Any) -> None:
        """Draws the panel; called by Blender."""
        column = self.layout.column()
        width = max(context.region.width // 8, 24)
        for sentence in connection.notes():
            for i, line in enumerate(_lines(sentence, width)):
                column.label(text=line, icon="BLANK1" if i else "INFO")


class RAYFARM_PT_passes(_Panel, bpy.types.Panel):
    """The panel that selects the render passes."""

    bl_label = "Passes"
    bl_context = "view_layer"

    def draw(self, context: Any) -> None:
        """Draws the panel; called by Blender."""
        layer = context.view_layer
        column = self.layout.column()
        for name in ("use_pass_z", "use_pass_position", "use_pass_normal", "use_pass_object_index", "use_pass_material_index"):
            column.prop(layer, name)
        column.prop(context.scene.rayfarm, "albedo")


def _lines(sentence: str, width: int) -> list[str]:
    import textwrap

    return textwrap.wrap(sentence, width) or [sentence]


CLASSES = (
    RAYFARM_OT_test_connection,
    RAYFARM_PT_farm,
    RAYFARM_PT_sampling,
    RAYFARM_PT_motion_blur,
    RAYFARM_PT_notes,
    RAYFARM_PT_passes,
)
