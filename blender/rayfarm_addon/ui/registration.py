"""Registers the engine and its panels, and enables Blender's own panels for the engine."""

from __future__ import annotations

import atexit

import bpy

from . import connection, panels, settings
from .engine import RayfarmEngine

__all__ = ["register", "unregister"]

CLASSES = (*settings.CLASSES, RayfarmEngine, *panels.CLASSES)
# Panels of other engines whose settings this engine supports.
ADDITIONAL_PANELS = (
    "EEVEE_MATERIAL_PT_surface",
    "EEVEE_MATERIAL_PT_context_material",
    "EEVEE_WORLD_PT_surface",
    "DATA_PT_EEVEE_light",
    "DATA_PT_EEVEE_light_distance",
    "MATERIAL_PT_preview",
)
EXCLUDED_PANELS = ("VIEWLAYER_PT_filter", "VIEWLAYER_PT_layer_passes", "RENDER_PT_freestyle", "VIEWLAYER_PT_freestyle")


def _panels() -> list[type]:
    found = []
    for panel in bpy.types.Panel.__subclasses__():
        engines = getattr(panel, "COMPAT_ENGINES", ())
        name = panel.__name__
        if name in EXCLUDED_PANELS or not isinstance(engines, set):
            continue
        if "BLENDER_RENDER" in engines or name in ADDITIONAL_PANELS:
            found.append(panel)
    return found


def register() -> None:
    """Registers all classes and panels."""
    for each in CLASSES:
        bpy.utils.register_class(each)
    settings.register()
    for panel in _panels():
        panel.COMPAT_ENGINES.add(RayfarmEngine.bl_idname)
    atexit.register(unregister)  # with our classes still registered, a Python that has Blender as a module hangs at exit


def unregister() -> None:
    """Unregisters all classes and panels."""
    atexit.unregister(unregister)
    connection.close()
    for panel in _panels():
        panel.COMPAT_ENGINES.discard(RayfarmEngine.bl_idname)
    settings.unregister()
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)
