"""Evaluates the JSON of a glTF file at a moment of its animations (specification 3.11, appendix C; KHR_animation_pointer).

Each channel names a property in the JSON. Its value at the moment is written there, so other modules need no code for animation.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from renderer.scene.animation import Clip, Curve, Moment
from renderer.scene.animation.moment import ALL_CLIPS
from renderer.scene.files import SceneFiles
from renderer.scene.readers.gltf import pointers
from renderer.scene.readers.gltf.accessors import Accessors
from renderer.scene.readers.gltf.container import Json
from renderer.scene.readers.gltf.faults import DamagedError
from renderer.scene.readers.name_lookup import number_of
from renderer.scene.readers.replaced_values import Changed, Path
from renderer.sentences import Sentence, first_items

__all__ = ["EXTENSION", "Animations"]

EXTENSION = "KHR_animation_pointer"

_WIDTHS: dict[pointers.Kind, int] = {"number": 1, "list": 1, "flag": 1, "pair": 2, "triple": 3, "quadruple": 4, "rotation": 4}
_MAX_LISTED = 8  # properties that a warning names


class Channel(NamedTuple):
    """An animation channel: the path in the JSON of the value that it animates, and its curve."""

    path: Path
    kind: pointers.Kind
    curve: Curve


class Animations:
    """The animation clips of a file; evaluates its JSON at a moment of one of them."""

    def __init__(self, root: Json, accessors: Accessors, files: SceneFiles) -> None:
        self._root, self._accessors, self._files = root, accessors, files
        self._sources = root.objects("animations")
        self._meshes: list[Json] | None = None
        self._times: dict[int, npt.NDArray[np.float64]] = {}
        names = [source.text("name", "") or f"animation {i}" for i, source in enumerate(self._sources)]
        self.clips = [Clip(name, *self._extent(source)) for name, source in zip(names, self._sources, strict=True)]
        # Blender writes one animation per object; if no two move the same target, they are played together.
        self._is_of_parts = (
            len(names) > 1
            and ALL_CLIPS not in names
            and files.get_or_make(("clips apart", root.file), self._have_distinct_targets)
        )
        if self._is_of_parts:
            moving = [clip for clip in self.clips if clip.end > clip.start] or self.clips
            self.clips.insert(0, Clip(ALL_CLIPS, min(clip.start for clip in moving), max(clip.end for clip in moving)))
        self.warnings: list[str] = []
        self.moving: set[Path] = set()  # animated paths of the clips that are played

    def root_at(self, moment: Moment) -> Json:
        """Returns the file's root with the animated values at a moment.

        Raises SceneError if the clip does not exist or is damaged.
        """
        names = [clip.name for clip in self.clips]
        played = self._sources if self._is_of_parts else self._sources[:1]
        if moment.clip == ALL_CLIPS and ALL_CLIPS not in names and names:
            played = self._sources
        elif moment.clip is not None:
            number = number_of("clip", names, moment.clip, self._root.file) - self._is_of_parts
            played = self._sources if number < 0 else [self._sources[number]]
        changed = Changed(self._root.value)
        for source in played:
            channels, moving, warnings = self._files.get_or_make(
                ("channels", source.file, source.where), functools.partial(self._channels, source)
            )
            self.warnings += [each for each in warnings if each not in self.warnings]
            self.moving |= moving
            for path, kind, curve in channels:
                values = curve.values_at(moment.seconds())
                if path[-2] == "weights" and not self._has_weight(changed, path):
                    continue
                changed.set(path, values[0] != 0 if kind == "flag" else values[0] if kind == "number" else values)
        return Json(self._root.file, "", changed.root, self._root.faults)

    def _have_distinct_targets(self) -> bool:
        """Returns True if no two animations have the same target."""
        known: set[str] = set()
        for source in self._sources:
            targets = [target for channel in source.objects("channels") if (target := channel.object("target"))]
            moved = {pointer for target in targets if (pointer := _pointer(target)) is not None}
            if not known.isdisjoint(moved):
                return False
            known |= moved
        return True

    def _has_weight(self, changed: Changed, path: Path) -> bool:
        """Returns True if the morph weight at `path`, which a channel animates, exists.

        The list of weights in `changed` is extended to one weight per morph target. A node that uses its mesh's weights gets a
        list of its own.
        """
        family, number, _, which = path
        source = mesh = Json(self._root.file, f"{family}[{number}]", changed.root[str(family)][number], self._root.faults)
        if family == "nodes":
            if self._meshes is None:
                self._meshes = self._root.objects("meshes")
            meshes = self._meshes
            at = source.index("mesh", meshes)
            if at is None:
                return False
            mesh = meshes[at]
        weights = (source if "weights" in source else mesh).numbers("weights")
        targets = max((len(p.objects("targets")) for p in mesh.objects("primitives")), default=0)
        changed.set(path[:-1], [*weights, *[0.0] * (targets - len(weights))])
        return isinstance(which, int) and which < max(targets, len(weights))

    def _extent(self, source: Json) -> tuple[float, float]:
        times = []
        for sampler in source.objects("samplers"):
            with self._count_faults(sampler):
                if "input" in sampler:
                    times.append(self._input(sampler))
        times = [each[np.isfinite(each)] for each in times]
        times = [each for each in times if len(each)]
        return (min(float(t[0]) for t in times), max(float(t[-1]) for t in times)) if times else (0.0, 0.0)

    @staticmethod
    @contextlib.contextmanager
    def _count_faults(source: Json) -> Iterator[None]:
        """Context in which an unusable part of the file is left out: a DamagedError is counted as a fault, and not raised."""
        try:
            yield
        except DamagedError as fault:
            source.faults.add(fault)

    def _input(self, sampler: Json) -> npt.NDArray[np.float64]:
        """Returns a sampler's key times; they may include non-finite values. Raises DamagedError if they do not ascend."""
        at = sampler.integer("input", high=len(self._accessors.accessors))
        if at not in self._times:
            times = self._accessors.floats(at, 1, finite=False).reshape(-1).astype(np.float64)
            if (np.diff(times[np.isfinite(times)]) < 0).any():
                raise sampler.damage("input", Sentence("gltf-animation-times-descend", "has times that do not ascend"))
            self._times[at] = times
        return self._times[at]

    def _channels(self, source: Json) -> tuple[list[Channel], set[Path], list[str]]:
        """Returns an animation's channels, the paths that they animate, and warnings about unsupported channels."""
        samplers = source.objects("samplers")
        found: list[Channel] = []
        left_out: list[str] = []
        for channel in source.objects("channels"):
            target = channel.object("target")
            pointer = _pointer(target) if target else None
            if pointer is None or pointers.template(pointer) in pointers.IDLE:
                continue
            kind = pointers.kind_of(pointer)
            path = None if kind is None else pointers.find(self._root.value, pointer)
            if kind is None or path is None or self._is_fixed_by_matrix(path):
                left_out.append(pointer[:120])
                continue
            with self._count_faults(channel):
                sampler = samplers[channel.integer("sampler", high=len(samplers))]
                found.append(Channel(path, kind, self._curve(sampler, kind)))
        moving = {channel.path for channel in found if not channel.curve.is_constant}
        if not left_out:
            return found, moving, []
        return (
            found,
            moving,
            [
                Sentence(
                    "gltf-animation-not-read",
                    "Animated properties that are missing or not supported stand still: {targets}.",
                    targets=first_items(dict.fromkeys(left_out), _MAX_LISTED),
                )
            ],
        )

    def _is_fixed_by_matrix(self, path: Path) -> bool:
        """Returns True if a path is in a node with a matrix, and is its translation, rotation or scale.

        The specification (3.11) forbids animating these.
        """
        if path[0] != "nodes" or path[-1] not in ("translation", "rotation", "scale"):
            return False
        return "matrix" in self._root.value["nodes"][path[1]]

    def _curve(self, sampler: Json, kind: pointers.Kind) -> Curve:
        times = self._input(sampler)
        at = sampler.integer("output", high=len(self._accessors.accessors))
        values = self._accessors.floats(at, _WIDTHS[kind], finite=False).astype(np.float64)
        way = sampler.text("interpolation", "LINEAR")
        if way not in ("STEP", "LINEAR", "CUBICSPLINE"):
            sampler.fault(
                "interpolation",
                Sentence("gltf-interpolation-unknown", "is {value}; known are STEP, LINEAR, CUBICSPLINE", value=repr(way[:20])),
            )
            way = "LINEAR"
        rows = len(times) * (3 if way == "CUBICSPLINE" else 1)
        if not rows or len(values) % rows or (kind != "list" and len(values) != rows):
            raise sampler.damage(
                "output",
                Sentence(
                    "gltf-animation-value-count-wrong",
                    "has {values} values for {times} times",
                    values=len(values),
                    times=len(times),
                ),
            )
        values = values.reshape(len(times), -1)
        finite = np.isfinite(times) & np.isfinite(values).all(axis=1)
        if not finite.all():
            what = Sentence(
                "gltf-keys-not-finite",
                "has {count} keys of {total} that are not finite numbers",
                count=int((~finite).sum()),
                total=len(times),
            )
            if not finite.any():
                raise sampler.damage("output", what)
            sampler.fault("output", what)
            times, values = times[finite], values[finite]
        turns = kind == "rotation"
        if way != "CUBICSPLINE":
            return Curve(times, values.reshape(len(times), -1), is_step=way == "STEP" or kind == "flag", is_rotation=turns)
        keys = values.reshape(len(times), 3, -1)  # in-tangent, value, out-tangent
        return Curve(times, keys[:, 1], slopes=keys[:, ::2], is_rotation=turns)


def _pointer(target: Json) -> str | None:
    """Returns the JSON pointer that a channel animates; None if its target has no node, as in unknown extensions (3.11)."""
    path = target.text("path", "")
    extension = target.extension(EXTENSION)
    if path == "pointer" and extension:
        return extension.text("pointer", "")
    node = target.value.get("node")
    return None if node is None else f"/nodes/{target.integer('node', 1 << 30)}/{path}"
