"""Converts Blender's cameras to Rayfarm's scene format."""

from __future__ import annotations

import math
from functools import partial
from typing import Any

from .keys import keyed
from .sentences import Sentence

__all__ = ["Cameras", "to_ours"]

MIN_SHIFT = 1e-6  # of a lens shift: smaller values are rounding errors


def to_ours(v: Any) -> tuple[float, float, float]:
    """Converts a point or direction from Blender's world (Z up) to Rayfarm's (Y up)."""
    return float(v[0]), float(v[2]), -float(v[1])


class Cameras:
    """Converts the scene's cameras, the active one first."""

    def __init__(self, bpy: Any, scene: Any, notes: list[str]) -> None:
        from mathutils import Vector

        self._bpy, self._scene, self._notes, self._vector = bpy, scene, notes, Vector
        found = [thing for thing in scene.objects if thing.type == "CAMERA"]
        self._all = sorted(found, key=lambda thing: (thing is not scene.camera, thing.name))
        meshes = [each for each in scene.objects if each.type == "MESH" and not each.hide_render]
        self._corners = [each.matrix_world @ Vector(c) for each in meshes for c in each.bound_box]
        self._middle = sum(self._corners, Vector((0, 0, 0))) / max(len(self._corners), 1)
        for thing in self._all:
            self._note_limits(thing)

    def state_functions(self) -> dict[str, Any]:
        """Returns camera name -> function that returns the camera's current state."""
        return {thing.name: partial(self._current_state, thing) for thing in self._all}

    def scene_file_cameras(self, states: dict[str, list[dict[str, Any]]], frames: list[int], fps: float) -> list[dict[str, Any]]:
        """Returns the cameras for the scene file. states: camera name -> the camera's states at each of the frames."""
        cameras = []
        for thing in self._all:
            values = states[thing.name]
            fixed = {name: values[0][name] for name in ("projection",)}
            varied = {name: keyed([each[name] for each in values], frames, fps) for name in values[0] if name not in fixed}
            straight = [name for name in ("shift_x", "shift_y") if varied.get(name) == 0.0]
            for name in straight:
                del varied[name]
            cameras.append({"name": thing.name[:200], **fixed, **varied})
        return cameras

    def _current_state(self, thing: Any) -> dict[str, Any]:
        graph = self._bpy.context.evaluated_depsgraph_get()
        camera = thing.evaluated_get(graph)
        data, world = camera.data, camera.matrix_world
        eye = world.translation
        forward = (world.to_3x3() @ self._vector((0, 0, -1))).normalized()
        up = (world.to_3x3() @ self._vector((0, 1, 0))).normalized()
        is_blurred = data.dof.use_dof and data.type == "PERSP"
        focus = self._focus(camera, forward, graph) if is_blurred else 0.0
        away = focus or max((self._middle - eye).dot(forward), 1.0)
        found: dict[str, Any] = {
            "projection": {"PERSP": "perspective", "ORTHO": "orthographic"}.get(data.type, "panorama"),
            "eye": to_ours(eye),
            "target": to_ours(eye + forward * away),
            "up": to_ours(up),
        }
        corners = data.view_frame(scene=self._scene)  # counter-clockwise, starting with the upper right corner
        height = max(c.y for c in corners) - min(c.y for c in corners)
        middle = [sum(getattr(c, axis) for c in corners) / 4 / max(height, 1e-12) for axis in ("x", "y")]
        if data.type != "PANO":
            found["shift_x"], found["shift_y"] = (each if abs(each) > MIN_SHIFT else 0.0 for each in middle)
        if data.type == "PERSP":
            depth = abs(corners[0].z) or 1.0
            found["fov"] = min(max(math.degrees(2 * math.atan(height / 2 / depth)), 0.01), 179.0)
            found["near"] = max(data.clip_start, 0.0)
            if is_blurred:
                found["aperture"] = data.lens * 1e-3 / (2 * max(data.dof.aperture_fstop, 1e-4))
                found["focus"] = focus
        elif data.type == "ORTHO":
            scale = world.to_scale()
            found["height"] = max(height * abs(scale.y), 1e-9)
            found["near"] = max(data.clip_start, 0.0)
        return found

    def _focus(self, camera: Any, forward: Any, graph: Any) -> float:
        dof = camera.data.dof
        if dof.focus_object is None:
            return max(dof.focus_distance, 1e-4)
        there = dof.focus_object.evaluated_get(graph)
        place = there.matrix_world.translation
        if dof.focus_subtarget and there.pose is not None and (bone := there.pose.bones.get(dof.focus_subtarget)):
            place = there.matrix_world @ bone.head
        return max(abs((place - camera.matrix_world.translation).dot(forward)), 1e-4)

    def _distance_to_far_end(self, thing: Any) -> float:
        """Returns the distance from a camera to the farthest point of the scene."""
        eye, forward = thing.matrix_world.translation, thing.matrix_world.to_3x3() @ self._vector((0, 0, -1))
        return max(((point - eye).dot(forward.normalized()) for point in self._corners), default=0.0)

    def _note_limits(self, thing: Any) -> None:
        data, name = thing.data, thing.name
        if data.type != "PANO" and self._distance_to_far_end(thing) > data.clip_end:
            self._notes.append(
                Sentence(
                    "blend-clip-end",
                    "Camera {camera}: objects beyond its clip end of {distance} m are shown, unlike in Blender",
                    camera=name,
                    distance=f"{data.clip_end:g}",
                )
            )
        if data.type == "PANO" and _panorama(data) not in ("EQUIRECTANGULAR", None):
            self._notes.append(
                Sentence(
                    "blend-panorama",
                    "Camera {camera}: rendered as an equirectangular panorama, not as {panorama}",
                    camera=name,
                    panorama=_panorama(data).lower(),
                )
            )
        if data.type == "CUSTOM":
            self._notes.append(
                Sentence("blend-lens-script", "Camera {camera}: its lens is a script, which is not run", camera=name)
            )
        if data.dof.use_dof and data.type != "PERSP":
            self._notes.append(
                Sentence(
                    "blend-depth-of-field",
                    "Camera {camera}: depth of field is left out, since only perspective cameras have it",
                    camera=name,
                )
            )
        if data.dof.use_dof and (data.dof.aperture_blades or data.dof.aperture_ratio != 1.0):
            self._notes.append(
                Sentence("blend-aperture", "Camera {camera}: its aperture is circular; blades and ratio are ignored", camera=name)
            )


def _panorama(data: Any) -> Any:
    """Returns a camera's panorama type. It is a property of the camera since Blender 5, of Cycles' camera settings before."""
    own = getattr(data, "panorama_type", None)
    return own or getattr(getattr(data, "cycles", None), "panorama_type", None)
