"""Converts meshes deformed by modifiers (Alembic caches, cloth, geometry nodes) to meshes with a shape key per frame."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

__all__ = ["DeformedShapes", "armatures_disabled"]

RELATIVE_TOLERANCE = 1e-5  # relative to a coordinate: smaller differences are rounding errors
MAX_KEYED_VERTICES = 6_000_000  # vertices of all shape keys: each takes 24 bytes of the file, and a microsecond or two to write


class DeformedShapes:
    """The shapes at each frame of meshes that modifiers deform, except armatures, which are exported as skins.

    left: names of meshes that stay static because the data would be too large or because their number of vertices changes.
    """

    def __init__(self, bpy: Any, scene: Any, visible_names: set[str], frames: list[int]) -> None:
        """Samples the shapes at all frames. visible_names: names of the visible objects."""
        self._bpy, self._scene, self._frames = bpy, scene, frames
        self._shapes: dict[str, list[Any]] = {}
        self._first: dict[str, Any] = {}
        self._other: set[str] = set()  # objects whose number of vertices changes
        self.left: list[str] = []
        names = [name for name in sorted(visible_names) if _may_deform(scene.objects[name])]
        if len(frames) < 2 or not names:
            return
        with armatures_disabled([scene.objects[name] for name in names]):
            looked = {frames[0], frames[1], frames[len(frames) // 3], frames[len(frames) // 2], frames[-1]}
            bent = self._deformed_names(names, sorted(looked))
            self.left = [name for name in bent if not self._may_have_keys(name)]
            kept = [name for name in bent if name not in self.left]
            self._shapes = self._positions_at_frames(kept)

    def add_shape_keys(self, thing: Any) -> None:
        """Adds an animated shape key per frame to a mesh object whose own shape is that of the first frame."""
        shapes = self._shapes.get(thing.name)
        if shapes is None or len(shapes[0]) != 3 * len(thing.data.vertices):
            if shapes is not None:
                self.left.append(thing.name)
            return
        thing.shape_key_add(name="Basis", from_mix=False)
        last = len(self._frames) - 1
        for i, (frame, points) in enumerate(zip(self._frames, shapes, strict=True)):
            key = thing.shape_key_add(name=f"frame {frame}", from_mix=False)
            key.data.foreach_set("co", points)
            for at, value in ((i - 1, 0.0), (i, 1.0), (i + 1, 0.0)):
                if 0 <= at <= last:
                    key.value = value
                    key.keyframe_insert("value", frame=self._frames[at])

    def _deformed_names(self, names: list[str], frames: list[int]) -> list[str]:
        """Returns the names of those objects whose evaluated shape differs between these frames."""
        found = set()
        for name, points in self._points_at_frames(names, frames):
            before = self._first.setdefault(name, points)
            if len(before) != len(points):
                found.add(name)
                self._other.add(name)
            elif len(points) and abs(before - points).max() > RELATIVE_TOLERANCE * max(1.0, abs(before).max()):
                found.add(name)
        return sorted(found)

    def _may_have_keys(self, name: str) -> bool:
        thing = self._scene.objects[name]
        return name not in self._other and (thing.data.shape_keys is None or len(thing.data.shape_keys.key_blocks) < 2)

    def _positions_at_frames(self, names: list[str]) -> dict[str, list[Any]]:
        """Returns object name -> its vertex positions at each frame, (3 V,) float32 each.

        Omits the largest meshes if the total is too large.
        """
        size = {name: len(self._first[name]) // 3 * len(self._frames) for name in names}
        for name in sorted(names, key=lambda each: -size[each]):
            if sum(size.values()) > MAX_KEYED_VERTICES:
                del size[name]
                self.left.append(name)
        found: dict[str, list[Any]] = {name: [] for name in size}
        for name, points in self._points_at_frames(list(size), self._frames):
            found[name].append(points)
        for name, shapes in list(found.items()):
            if any(len(each) != len(shapes[0]) for each in shapes):
                del found[name]
                self.left.append(name)
        return found

    def _points_at_frames(self, names: list[str], frames: list[int]) -> Iterator[tuple[str, Any]]:
        for frame in frames if names else ():
            self._scene.frame_set(frame)
            graph = self._bpy.context.evaluated_depsgraph_get()
            for name in names:
                yield name, _points(self._scene.objects[name].evaluated_get(graph).data)


@contextmanager
def armatures_disabled(objects: list[Any]) -> Iterator[None]:
    """Context manager that disables the armature modifiers of these objects."""
    bones = [each for thing in objects for each in thing.modifiers if each.type == "ARMATURE" and each.show_viewport]
    for each in bones:
        each.show_viewport = False
    try:
        yield
    finally:
        for each in bones:
            each.show_viewport = True


def _may_deform(thing: Any) -> bool:
    return thing.type == "MESH" and any(each.type != "ARMATURE" for each in thing.modifiers)


def _points(mesh: Any) -> Any:
    import numpy as np

    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    return points
