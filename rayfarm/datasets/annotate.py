"""The annotation of one view of a data set: planes as arrays; boxes and masks of each body as JSON."""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.errors import SettingsError
from renderer.scene.animation import Moment
from renderer.settings import RenderSettings, View

if TYPE_CHECKING:
    from rayfarm.reading import ConfinedScene
    from renderer.annotation import Annotation, Body
    from renderer.scene.compiled import CompiledScene

__all__ = ["FLOWS", "OUTPUTS", "Annotator", "ViewAnnotation", "rle"]

Array = npt.NDArray[Any]

FLOWS = ("flow_forward", "flow_backward", "scene_flow_forward", "scene_flow_backward")
_IN_SPACE = "scene_"  # prefix of flow in space, not in the picture
OCCLUDED = "_occluded"  # suffix of a flow's mask
_NUMBERED = re.compile(r"(?<=\w)[._ -]?\d+$")


class _Bodies(NamedTuple):
    """The bodies of a compiled scene, and their numbers by object and by instance."""

    compiled: CompiledScene
    listed: list[Body]
    numbers: tuple[Array, Array]  # of `body_numbers`


@dataclass(frozen=True)
class _Found:
    """One view's annotation, and what planes are computed from besides. category: 1 + number of the category, by object."""

    annotation: Annotation
    view: View
    origin: Array
    bodies: _Bodies
    category_of: Array
    materials: int

    @cached_property
    def places(self) -> Array:
        """Returns the points (h, w, 3) float64 in world space."""
        from renderer.annotation import NOW

        points: Array = self.annotation.places_at(NOW)[..., :3] + self.origin
        return points

    @cached_property
    def surface(self) -> Array:
        """Returns whether there is a surface (h, w)."""
        from renderer.annotation import NOW

        there: Array = self.annotation.places_at(NOW)[..., 3] != 0
        return there


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


def _instance(found: _Found) -> Array:
    """Returns 1 + the index of each pixel's body; 0 where there is none."""
    (of_world, of_instance), seen = found.bodies.numbers, found.annotation
    body = np.where(seen.instance < 0, of_world[np.maximum(seen.object, 0)], of_instance[np.maximum(seen.instance, 0)])
    return np.where(seen.object >= 0, body, 0).astype(np.int32)


def _category(found: _Found) -> Array:
    number = found.annotation.object
    known = found.category_of[np.maximum(number, 0)] if len(found.category_of) else 0
    return np.where(number >= 0, known, 0).astype(np.int32)


def _part(found: _Found) -> Array:
    """Returns 1 + object * number of materials + material; 0 where there is none."""
    seen = found.annotation
    return np.where(seen.object >= 0, 1 + seen.object * found.materials + seen.material, 0).astype(np.int32)


def _scene_flow(found: _Found, when: int) -> Array:
    """Returns how far each point moves in world space (h, w, 3) until another view. when: as of `Annotation.places_at`."""
    from renderer.annotation import NOW

    moved = found.annotation.places_at(when)[..., :3] - found.annotation.places_at(NOW)[..., :3]
    return np.where(found.surface[..., None], moved, np.nan).astype(np.float32)


# Each plane by its name: how it is computed. Numbers of objects and materials are those of the film's planes: 0 is none.
_PLANES: dict[str, Callable[[_Found], Array]] = {
    "depth": _depth,
    "distance": _distance,
    "position": _position,
    "normal": lambda found: found.annotation.normal,
    "normal_camera": _camera_normal,
    "object": lambda found: found.annotation.object + 1,
    "instance": _instance,
    "material": lambda found: found.annotation.material + 1,
    "part": _part,
    "category": _category,
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
        self._bodies: _Bodies | None = None

    def annotate(self, number: int) -> ViewAnnotation:
        """Returns the annotation of a view. Raises SceneError."""
        from renderer.annotation import AFTER, BEFORE, annotate, flow_to
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
        found = _Found(seen, view, compiled.origin, bodies, self._category, len(self.materials))
        planes = {name: _PLANES[name](found) for name in self._outputs if name in _PLANES}
        for name in FLOWS:
            if name not in self._outputs or (other := self._neighbour(name, number)) is None:
                continue
            when = AFTER if other > number else BEFORE
            if name.startswith(_IN_SPACE):
                planes[name] = _scene_flow(found, when)
            else:
                flow = flow_to(compiled, settings, seen, self._views[other], when, self._threads, window)
                planes |= {name: flow.offset, f"{name}{OCCLUDED}": flow.occluded.astype(np.uint8)}
        described = self._described(seen, bodies, summary.get("poses", {})) if is_listed else None
        return ViewAnnotation(planes, described, summary.get("variation", {}))

    def _neighbour(self, name: str, number: int) -> int | None:
        """Returns the number of the view that a flow leads to; None if there is none, or if it shows another variation."""
        other = number + (1 if name.endswith("forward") else -1)
        if not 0 <= other < len(self._views) or (self._every and other // self._every != number // self._every):
            return None
        return other

    def _bodies_of(self, compiled: CompiledScene) -> _Bodies:
        from renderer.annotation import bodies_of, body_numbers

        if self._bodies is None or self._bodies.compiled is not compiled:
            listed = bodies_of(compiled)
            self._bodies = _Bodies(compiled, listed, body_numbers(listed, len(self.objects)))
        return self._bodies

    def _described(self, seen: Annotation, bodies: _Bodies, poses: dict[str, Any]) -> list[dict[str, Any]]:
        """Returns the bodies that are in the picture, whether occluded or not, as JSON.

        poses: of moving objects, by number as text, for those whose geometry is in world space.
        """
        from renderer.annotation import masks_of

        has_masks, shape = "masks" in self._outputs, seen.ids.shape[:2]
        described = []
        masks = masks_of(seen, bodies.numbers, len(bodies.listed), has_masks)
        for number, (body, (whole, visible)) in enumerate(zip(bodies.listed, masks, strict=True), 1):
            category = int(self._category[body.object])
            if category == 0 or whole.area == 0:
                continue
            found: dict[str, Any] = {
                "instance": number,
                "object": body.object + 1,
                "name": self.objects[body.object],
                "category": category,
                "area": visible.area,
                "amodal_area": whole.area,
                "occlusion": round(1.0 - visible.area / whole.area, 6),
                "box": None if visible.box is None else list(visible.box),
                "amodal_box": None if whole.box is None else list(whole.box),
                "box_3d": body.corners.tolist(),
                "pose": poses.get(str(body.object), body.pose.tolist()) if body.instance < 0 else body.pose.tolist(),
            }
            if has_masks:
                found |= {"mask": rle(visible.edges, shape), "amodal_mask": rle(whole.edges, shape)}
            described.append(found)
        return described

    def _category_of(self, name: str) -> str | None:
        if self._given is None:
            return _NUMBERED.sub("", name) or name or "object"
        return next((category for pattern, category in self._given.items() if fnmatch.fnmatchcase(name, pattern)), None)


def rle(edges: list[int], shape: tuple[int, ...]) -> dict[str, Any]:
    """Returns a mask of `shape` (h, w) as COCO's run lengths, column by column, of zeros first. edges: of a `Mask`."""
    size = shape[0] * shape[1]
    ends = [*edges, size] if not edges or edges[-1] < size else edges
    return {"size": list(shape), "counts": [end - start for start, end in pairwise([0, *ends])]}
