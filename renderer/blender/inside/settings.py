"""What the scene itself asks for, as settings of ours; and what of it is not taken over."""

from __future__ import annotations

from typing import Any

__all__ = ["note_settings", "settings_of"]

FEW = 4  # bounces, as Cycles has them unless told: more than these add little
NEAR = 1e-3


def settings_of(scene: Any) -> dict[str, Any]:
    """Size, depth and shutter."""
    render = scene.render
    part = render.resolution_percentage / 100
    found: dict[str, Any] = {
        "width": min(max(round(render.resolution_x * part), 1), 16384),
        "height": min(max(round(render.resolution_y * part), 1), 16384),
    }
    cycles = getattr(scene, "cycles", None)
    if render.engine == "CYCLES" and cycles is not None:
        found["max_depth"] = min(cycles.max_bounces + 2, 1024)  # their first bounce is what a camera's hit is lit by
    if render.use_motion_blur:
        found["shutter"] = round(min(max(render.motion_blur_shutter, 0.001), 64.0), 6)
        found["shutter_at"] = "trailing" if getattr(render, "motion_blur_position", "CENTER") == "END" else "centred"
    return found


def _is_curved(shutter: Any) -> bool:
    """Whether a shutter lets less light through while it opens or closes."""
    return any(point.location[1] < 1 - NEAR for curve in shutter.curves[:1] for point in curve.points)


def note_settings(scenes: Any, scene: Any, notes: list[str]) -> None:
    """scenes: all of the file's."""
    render, cycles = scene.render, getattr(scene, "cycles", None)
    if len(scenes) > 1:
        others = sorted(each.name for each in scenes if each.name != scene.name)
        notes.append(f"Of the file's scenes the one that it was saved with is shown, not {', '.join(others[:5])}")
    if len([layer for layer in scene.view_layers if layer.use]) > 1:
        notes.append("Of the scene's view layers the one that it was saved with is shown")
    if render.use_border:
        notes.append("The whole picture is rendered, not the region that is set in Blender")
    if abs(render.pixel_aspect_x - render.pixel_aspect_y) > 1e-6:
        notes.append("Pixels that are not square are rendered as square ones")
    if render.film_transparent:
        notes.append("Transparent film: the world is seen behind the scene, and there is no alpha")
    if cycles is not None and render.engine == "CYCLES":
        least = min(cycles.diffuse_bounces, cycles.glossy_bounces, FEW)
        if least < min(cycles.max_bounces, FEW):
            notes.append(
                f"Light bounces up to {cycles.max_bounces} times between all kinds of surface, not {least} times between some"
            )
        if cycles.use_fast_gi:
            notes.append("Light between surfaces is followed, not approximated (Fast GI)")
    if render.use_motion_blur and cycles is not None and cycles.rolling_shutter_type != "NONE":
        notes.append("The shutter opens everywhere at once, without rolling")
    if render.use_motion_blur and _is_curved(render.motion_blur_shutter_curve):
        notes.append("The shutter opens and closes at once, whatever its curve")
    if cycles is not None and render.engine == "CYCLES" and abs(cycles.film_exposure - 1) > 1e-3:
        notes.append(f"The film's exposure of {cycles.film_exposure:g} is not taken over; set it where the picture is looked at")
    view = scene.view_settings
    looks = [
        words
        for is_so, words in (
            (abs(view.exposure) > 1e-3, f"exposure {view.exposure:g}"),
            (abs(view.gamma - 1) > 1e-3, f"gamma {view.gamma:g}"),
            (view.look != "None", f"look {view.look}"),
            (view.use_curve_mapping, "curves"),
        )
        if is_so
    ]
    if looks:
        notes.append(f"Color management ({', '.join(looks)}) is not taken over; set it where the picture is looked at")
    if render.use_multiview:
        notes.append("Stereoscopy: one picture is rendered, as the camera sees it with one eye")
    if len({marker.camera.name for marker in scene.timeline_markers if marker.camera is not None}) > 1:
        notes.append("Markers of the timeline switch between cameras: here a camera is chosen by its name for all frames")
    tree = getattr(scene, "compositing_node_group", None) or getattr(scene, "node_tree", None)
    plain = {"R_LAYERS", "COMPOSITE", "VIEWER", "REROUTE", "GROUP_OUTPUT"}
    if render.use_compositing and tree is not None and any(node.type not in plain for node in tree.nodes):
        notes.append("What the compositor makes of the picture is not taken over")
    if render.use_freestyle:
        notes.append("Freestyle's lines are not drawn")
