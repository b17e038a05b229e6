"""A scene over time in this process, compiled again only if more than a camera has moved."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from dataclasses import fields, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from renderer.scene.animation import BETWEEN, Moment, Shutter

if TYPE_CHECKING:
    from renderer.scene.compiled import CompiledScene
    from renderer.scene.description import SceneDescription
    from renderer.scene.frame_reuse import PartOffsets, ShotCache
    from renderer.scene.load import Shot

__all__ = ["OpenScene"]

Say = Callable[[str], None]


class _CompiledMoment(NamedTuple):
    """A scene at one moment: its description before and after compiling, the compiled scene, and its summary."""

    read: SceneDescription
    described: SceneDescription
    compiled: CompiledScene
    summary: dict[str, Any]


class OpenScene:
    """A compiled scene over time. Its state at a moment does not depend on the moments requested before.

    camera: as in --camera. shutter: the given shutter settings.
    """

    def __init__(
        self,
        shot: Shot,
        camera: str | None = None,
        brute: bool = False,
        threads: int | None = None,
        shutter: Mapping[str, Any] = MappingProxyType({}),
    ) -> None:
        self._shot, self._camera, self._brute, self._threads = shot, camera, brute, threads
        self._shutter = shutter
        self._last: _CompiledMoment | None = None
        self._kept: ShotCache | None = None
        self._auto: dict[str, Any] | None = None

    def scene_at(self, moment: Moment, say: Say = lambda step: None) -> tuple[CompiledScene, dict[str, Any]]:
        """Returns the compiled scene at a moment, and its summary. say: called with each step when it begins. Raises SceneError.

        A scene that moves has `poses` in its summary, as of `moving_poses`. The result is valid until the next call, which
        modifies it in place. For a scene without a camera, the automatic camera frames the scene as it is at its start, and does
        not move.
        """
        return self._compile_moment(moment, say, lambda each: self._shot.over_shutter(each, self._shutter))

    def between_neighbours(self, moment: Moment, shutter: Shutter = BETWEEN) -> tuple[CompiledScene, dict[str, Any]]:
        """Like `scene_at`, but compiles the time from the previous to the next frame, for motion vectors.

        shutter: another time around the moment.
        """
        return self._compile_moment(moment, lambda step: None, lambda each: self._shot.between_frames(each, shutter))

    @property
    def part_offsets(self) -> PartOffsets:
        """Returns the offsets of the parts in the most recently compiled scene."""
        assert self._kept is not None and self._kept.cuts is not None
        return self._kept.cuts

    def _compile_moment(
        self, moment: Moment, say: Say, read_at: Callable[[Moment], SceneDescription]
    ) -> tuple[CompiledScene, dict[str, Any]]:
        from renderer.scene.compile import summarise_again
        from renderer.scene.object_ids import moving_poses
        from renderer.scene.scene_equality import compiles_alike

        if self._last is not None and not self._last.read.moves:
            return self._last.compiled, self._last.summary
        say("reading")
        read = read_at(moment)
        frames_itself = read.moves and self._uses_automatic_camera(read)
        if frames_itself and self._auto is None and moment.frame != self._shot.start:
            say("framing")
            self._last = self._built(self._shot.scene_at(replace(moment, frame=self._shot.start)))
            self._auto = self._last.summary["cameras"][-1]
            read = read_at(moment)
        if self._last is not None and compiles_alike(read, self._last.read):
            described = replace(self._last.described, cameras=read.cameras, variation=read.variation)
            self._last = self._last._replace(read=read, described=described)
        else:
            say("building")
            self._last = self._built(read)
        if frames_itself and self._auto is None:
            self._auto = self._last.summary["cameras"][-1]
        if read.moves:
            summary = summarise_again(self._last.described, self._last.compiled, self._last.summary)
            summary["poses"] = moving_poses(read)
            if frames_itself:
                summary["cameras"][-1] = self._auto
            self._last = self._last._replace(summary=summary)
        return self._last.compiled, self._last.summary

    def _built(self, read: SceneDescription) -> _CompiledMoment:
        from renderer.scene.compile import compile_scene, summarise
        from renderer.scene.frame_reuse import ShotCache

        self._kept = self._kept or ShotCache()
        before, self._last = self._last, None
        described = _copy_description(read)
        compiled = compile_scene(described, brute=self._brute, threads=self._threads, shot_cache=self._kept)
        if before is not None and read.still is not None and read.still is before.read.still:
            return _CompiledMoment(read, described, compiled, before.summary)
        return _CompiledMoment(read, described, compiled, summarise(described, compiled))

    def _uses_automatic_camera(self, description: SceneDescription) -> bool:
        """Returns True if the selected camera is the automatic one."""
        from rayfarm.options import find_camera
        from renderer.scene.compile import camera_names

        names = [{"name": name} for name in camera_names(description)]
        return find_camera(names, self._camera) == len(names) - 1


def _copy_description(description: SceneDescription) -> SceneDescription:
    """Returns a copy of the description for compiling, which appends to its lists but does not change their items."""
    held = {f.name: getattr(description, f.name) for f in fields(description)}
    copied: dict[str, Any] = {name: copy(value) for name, value in held.items() if isinstance(value, list | dict)}
    return replace(description, **copied)
