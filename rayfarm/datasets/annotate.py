"""The annotation of one view of a data set: planes as arrays; boxes and masks of each body as JSON."""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.errors import SettingsError
from renderer.scene.animation import Moment
from renderer.settings import RenderSettings, View

if TYPE_CHECKING:
    from rayfarm.reading import ConfinedScene
    from renderer.annotation import Annotation, Body

__all__ = ["FLOWS", "OUTPUTS", "Annotator", "ViewAnnotation", "rle"]

Array = npt.NDArray[Any]

FLOWS = ("flow_forward", "flow_backward", "scene_flow_forward", "scene_flow_backward")
_IN_SPACE = "scene_"  # prefix of flow in space, not in the picture
OCCLUDED = "_occluded"  # suffix of a flow's mask
_NUMBERED = re.compile(r"(?<=\w)[._ -]?\d+$")


class _Found(NamedTuple):
    """One view's annotation, and what planes are computed from besides."""

    annotation: Annotation
    places: Array  # (h, w, 3) float64, world space
    surface: Array  # (h, w) bool
    view: View
    instance: Array  # (h, w) int32: 1 + index of the body, 0 for none
    category: Array  # (h, w) int32: 1 + number of the category, 0 for none
    part: Array  # (h, w) int32: 1 + object * number of materials + material, 0 for none


def _axes(view: View) -> Array:
    from renderer.kernel.camera import axes_of

    right, up, back, _ = axes_of(view)
    return np.stack([right, up, back])


def _depth(found: _Found) -> Array:
    away = (found.places - np.array(found.view.eye)) @ -_axes(found.view)[2]
    return np.where(found.surface, away, np.inf).astype(np.float32)


def _distance(found: _Found) -> Array:
    away = np.linalg.norm(found.places - np.array(found.view.eye), axis=2)
    return np.where(found.surface, away, np.inf).astype(np.float32)


def _position(found: _Found) -> Array:
    return np.where(found.surface[..., None], found.places, np.nan).astype(np.float32)


def _camera_normal(found: _Found) -> Array:
    return (found.annotation.normal @ _axes(found.view).T).astype(np.float32)


def _scene_flow(seen: Annotation, surface: Array, when: int) -> Array:
    """Returns how far each point moves in world space (h, w, 3) until another view. when: as of `Annotation.places`."""
    from renderer.annotation import NOW

    moved = seen.places[:, :, when, :3] - seen.places[:, :, NOW, :3]
    return np.where(surface[..., None], moved, np.nan).astype(np.float32)


# Each plane by its name: how it is computed. Numbers of objects and materials are those of the film's planes: 0 is none.
_PLANES: dict[str, Callable[[_Found], Array]] = {
    "depth": _depth,
    "distance": _distance,
    "position": _position,
    "normal": lambda found: found.annotation.normal,
    "normal_camera": _camera_normal,
    "object": lambda found: found.annotation.object + 1,
    "instance": lambda found: found.instance,
    "material": lambda found: found.annotation.material + 1,
    "part": lambda found: found.part,
    "category": lambda found: found.category,
}
OUTPUTS = ("color", *_PLANES, *FLOWS, "boxes", "masks")


@dataclass(frozen=True)
class ViewAnnotation:
    """The annotation of one view: planes by name, and the bodies in the picture as JSON; None if not requested.

    variation: the values drawn for the view, if the scene varies.
    """

    planes: dict[str, Array]
    bodies: list[dict[str, Any]] | None
    variation: dict[str, Any]


def _rolling_shutter(settings: RenderSettings) -> dict[str, Any] | None:
    """Returns when each row, or column, is exposed, as dataset.json has it; times are in frames from the view's own."""
    from renderer.exposure import pixel_times
    from renderer.scene.animation import Shutter

    if not settings.rolling_shutter:
        return None
    times = pixel_times(settings, Shutter(1.0))
    return {
        "from": settings.rolling_shutter_from,
        "first": round(times.first + (times.across + times.down) / 2 - 0.5, 12),
        "step": round(times.across + times.down, 12),
        "exposure": round((1 - settings.rolling_shutter) * settings.shutter, 12),
    }


class Annotator:
    """Annotates the views of a data set, with the scene compiled in this process."""

    def __init__(
        self,
        stage: ConfinedScene,
        settings: Callable[[dict[str, Any]], RenderSettings],
        views: Sequence[View],
        outputs: Sequence[str],
        categories: Mapping[str, str] | None,
        fps: float | None,
        clip: str | None,
        threads: int | None,
        every: int = 0,
    ) -> None:
        """Stores the parameters. settings: returns the render settings, given the scene's summary; their size is used.

        categories: category by a pattern of object names; None: each object's name without its number is its category.
        every: number of views that share a variation of the scene, between which there is flow; 0: all.
        """
        self._stage, self._settings, self._views, self._outputs = stage, settings, views, outputs
        self._fps, self._clip, self._threads = fps, clip, threads
        self._given, self._every = categories, every
        _, summary = stage.scene_at(Moment(0.0, fps, clip))
        self.rolling_shutter = _rolling_shutter(settings(summary))
        self.objects: list[str] = list(summary["objects"])
        self.materials: list[str] = list(summary["materials"])
        of_object = [self._category_of(name) for name in self.objects]
        if categories is not None and not any(of_object):
            raise SettingsError(
                f"categories match no object of the scene; its objects are {', '.join(self.objects[:12]) or 'none'}"
            )
        self.categories = sorted({name for name in of_object if name is not None})
        self._category = np.array([0 if name is None else 1 + self.categories.index(name) for name in of_object], np.int32)
        self._bodies: tuple[Any, list[Body]] | None = None

    def annotate(self, number: int) -> ViewAnnotation:
        """Returns the annotation of a view. Raises SceneError."""
        from renderer.annotation import AFTER, BEFORE, NOW, annotate, flow_to
        from renderer.exposure import window_between

        moment = Moment(float(number), self._fps, self._clip)
        compiled, summary = self._stage.scene_at(moment)
        bodies = self._bodies_of(compiled)
        view = self._views[number]
        settings, window = replace(self._settings(summary), view=view, views=()), None
        if any(name in FLOWS for name in self._outputs):
            window = window_between(settings)
            compiled, summary = self._stage.between_neighbours(moment, window)
        is_listed = any(name in self._outputs for name in ("boxes", "masks"))
        seen = annotate(compiled, settings, is_listed, self._threads, window)
        surface = seen.places[:, :, NOW, 3] != 0
        places = seen.places[:, :, NOW, :3] + compiled.origin
        instance = self._instance_ids(seen.object, seen.instance, bodies)
        category = np.where(seen.object >= 0, self._category[np.maximum(seen.object, 0)] if self.objects else 0, 0)
        part = np.where(seen.object >= 0, 1 + seen.object * len(self.materials) + seen.material, 0)
        found = _Found(seen, places, surface, view, instance, category.astype(np.int32), part.astype(np.int32))
        planes = {name: _PLANES[name](found) for name in self._outputs if name in _PLANES}
        for name in FLOWS:
            if name not in self._outputs or (other := self._neighbour(name, number)) is None:
                continue
            when = AFTER if other > number else BEFORE
            if name.startswith(_IN_SPACE):
                planes[name] = _scene_flow(seen, surface, when)
            else:
                flow = flow_to(compiled, settings, seen, self._views[other], when, self._threads, window)
                planes |= {name: flow.offset, f"{name}{OCCLUDED}": flow.occluded.astype(np.uint8)}
        described = self._described(seen, instance, bodies, summary.get("poses", {})) if is_listed else None
        return ViewAnnotation(planes, described, summary.get("variation", {}))

    def _neighbour(self, name: str, number: int) -> int | None:
        """Returns the number of the view that a flow leads to; None if there is none, or if it shows another variation."""
        other = number + (1 if name.endswith("forward") else -1)
        if not 0 <= other < len(self._views) or (self._every and other // self._every != number // self._every):
            return None
        return other

    def _bodies_of(self, compiled: Any) -> list[Body]:
        from renderer.annotation import bodies_of

        if self._bodies is None or self._bodies[0] is not compiled:
            self._bodies = compiled, bodies_of(compiled)
        return self._bodies[1]

    def _instance_ids(self, number: Array, instance: Array, bodies: list[Body]) -> Array:
        """Returns 1 + the index of the body for each pair of an object and an instance; 0 where there is none."""
        of_world = np.zeros(len(self.objects) + 1, np.int32)
        of_instance = np.zeros(1 + max((body.instance + 1 for body in bodies), default=0), np.int32)
        for n, body in enumerate(bodies, 1):
            if body.instance < 0:
                of_world[body.object] = n
            else:
                of_instance[body.instance] = n
        found = np.where(instance < 0, of_world[np.maximum(number, 0)], of_instance[np.maximum(instance, 0)])
        return np.where(number >= 0, found, 0).astype(np.int32)

    def _described(self, seen: Annotation, visible: Array, bodies: list[Body], poses: dict[str, Any]) -> list[dict[str, Any]]:
        """Returns the bodies that are in the picture, whether occluded or not, as JSON.

        poses: of moving objects, by number as text, for those whose geometry is in world space.
        """
        layers = self._instance_ids(seen.layers[..., 0], seen.layers[..., 1], bodies)
        described = []
        for number in np.unique(layers[layers > 0]).tolist():
            body = bodies[number - 1]
            category = int(self._category[body.object])
            if category == 0:
                continue
            whole, part = (layers == number).any(axis=2), visible == number
            area = int(part.sum())
            found: dict[str, Any] = {
                "instance": number,
                "object": body.object + 1,
                "name": self.objects[body.object],
                "category": category,
                "area": area,
                "amodal_area": int(whole.sum()),
                "occlusion": round(1.0 - area / int(whole.sum()), 6),
                "box": _box(part),
                "amodal_box": _box(whole),
                "box_3d": body.corners.tolist(),
                "pose": poses.get(str(body.object), body.pose.tolist()) if body.instance < 0 else body.pose.tolist(),
            }
            if "masks" in self._outputs:
                found |= {"mask": rle(part), "amodal_mask": rle(whole)}
            described.append(found)
        return described

    def _category_of(self, name: str) -> str | None:
        if self._given is None:
            return _NUMBERED.sub("", name) or name or "object"
        return next((category for pattern, category in self._given.items() if fnmatch.fnmatchcase(name, pattern)), None)


def _box(mask: Array) -> list[int] | None:
    """Returns [x, y, width, height] of a mask in pixels; None if it is empty."""
    columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
    if not len(columns):
        return None
    x, y = int(columns[0]), int(rows[0])
    return [x, y, int(columns[-1]) + 1 - x, int(rows[-1]) + 1 - y]


def rle(mask: Array) -> dict[str, Any]:
    """Returns a mask (h, w) as COCO's run lengths: column by column, of zeros first."""
    flat = np.concatenate([[False], mask.T.reshape(-1).astype(bool)])
    changes = np.flatnonzero(flat[1:] != flat[:-1])
    edges = np.concatenate([[0], changes, [mask.size]])
    return {"size": list(mask.shape), "counts": np.diff(edges).tolist()}
