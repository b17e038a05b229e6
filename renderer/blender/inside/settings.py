"""Converts the scene's render settings to Rayfarm's, and adds notes on those that are ignored."""

from __future__ import annotations

from typing import Any

from .sentences import Sentence, first_items

__all__ = ["note_settings", "settings_of"]

USUAL_CLAMP, MOST_CLAMP = 10.0, 1e9  # the first is Blender's default and is ignored, since the user did not choose it
SHUTTERS = {"START": "leading", "CENTER": "centred", "END": "trailing"}


def settings_of(scene: Any, layer: Any, addon_module: Any) -> dict[str, Any]:
    """Returns the render settings: size, background, depths, shutter, and clamping and pixel filter that equal Cycles'.

    addon_module: the add-on's module of Cycles' settings, or None.
    """
    render = scene.render
    part = render.resolution_percentage / 100
    found: dict[str, Any] = {
        "width": min(max(round(render.resolution_x * part), 1), 16384),
        "height": min(max(round(render.resolution_y * part), 1), 16384),
    }
    if render.film_transparent:
        found["background"] = "transparent"
    cycles = getattr(scene, "cycles", None)
    if render.engine == "CYCLES" and cycles is not None:
        found["max_depth"] = min(cycles.max_bounces + 2, 1024)  # Cycles' first bounce is the direct light of a camera hit
        found |= addon_module.depths_of(scene) if addon_module is not None else {}
        if cycles.sample_clamp_indirect not in (0.0, USUAL_CLAMP):
            found["clamp_indirect"] = min(float(cycles.sample_clamp_indirect), MOST_CLAMP)
        if cycles.pixel_filter_type == "BOX":
            found["filter"] = "box"
    if render.use_motion_blur and getattr(layer, "use_motion_blur", True):
        found["shutter"] = round(min(max(render.motion_blur_shutter, 0.001), 64.0), 6)
        found["shutter_at"] = SHUTTERS.get(getattr(render, "motion_blur_position", "CENTER"), "centred")
        if addon_module is not None and (share := addon_module.rolling_shutter_of(scene)):
            found["rolling_shutter"] = share
    return found


def note_settings(scenes: Any, scene: Any, layer: Any, notes: list[str], addon_module: Any) -> None:
    """Adds notes on render settings that are ignored. scenes: all scenes of the file.

    addon_module: the add-on's module of Cycles' settings, or None.
    """
    render = scene.render
    if len(scenes) > 1:
        others = sorted(each.name for each in scenes if each.name != scene.name)
        notes.append(
            Sentence(
                "blend-other-scenes",
                "Only the scene that was active when the file was saved is rendered, not {names}",
                names=first_items(others, 5),
            )
        )
    if len([each for each in scene.view_layers if each.use]) > 1:
        notes.append(
            Sentence("blend-other-view-layers", "Only the view layer that was active when the file was saved is rendered")
        )
    if render.use_border:
        notes.append(Sentence("blend-render-region", "The whole picture is rendered, not Blender's render region"))
    if addon_module is not None:
        addon_module.warn_of_settings(scene, layer, notes.append, is_clamped=True, has_filter=False)
    view = scene.view_settings
    looks = [
        words
        for is_so, words in (
            (abs(view.exposure) > 1e-3, Sentence("blend-look-exposure", "exposure {value}", value=f"{view.exposure:g}")),
            (abs(view.gamma - 1) > 1e-3, Sentence("blend-look-gamma", "gamma {value}", value=f"{view.gamma:g}")),
            (view.look != "None", f"look {view.look}"),
            (view.use_curve_mapping, "curves"),
        )
        if is_so
    ]
    if looks:
        notes.append(
            Sentence("blend-color-management", "Color management ({settings}) is ignored; set it in the viewer", settings=looks)
        )
    if len({marker.camera.name for marker in scene.timeline_markers if marker.camera is not None}) > 1:
        notes.append(
            Sentence(
                "blend-camera-markers",
                "Camera markers of the timeline are ignored: one camera, chosen by name, renders all frames",
            )
        )
    tree = getattr(scene, "compositing_node_group", None) or getattr(scene, "node_tree", None)
    plain = {"R_LAYERS", "COMPOSITE", "VIEWER", "REROUTE", "GROUP_OUTPUT"}
    if render.use_compositing and tree is not None and any(node.type not in plain for node in tree.nodes):
        notes.append(Sentence("blend-compositor", "The compositor is ignored"))
    strips = getattr(scene.sequence_editor, "strips", None) or getattr(scene.sequence_editor, "sequences", ())
    if render.use_sequencer and any(not strip.mute for strip in strips or ()):
        notes.append(Sentence("blend-video-sequence", "The video sequence is ignored; the scene itself is rendered"))
    if render.use_freestyle:
        notes.append(Sentence("blend-freestyle", "Freestyle lines are left out"))
