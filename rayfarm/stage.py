"""A scene that is open in this process: what it is at each frame, compiled anew only where more than a camera moved."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from copy import copy
from dataclasses import fields, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

from rayfarm.options import Env, find_camera
from rayfarm.scene_files import opened
from renderer.scene.animation import Moment

if TYPE_CHECKING:
    from renderer.scene.compiled import CompiledScene
    from renderer.scene.description import SceneDescription
    from renderer.scene.load import Shot

__all__ = ["Stage", "open_stage"]

Say = Callable[[str], None]


class _Built(NamedTuple):
    """A scene at a moment: its description before and after it was compiled, and what came of it."""

    read: SceneDescription
    described: SceneDescription
    compiled: CompiledScene


class Stage:
    """A scene over time, compiled. What it is at a moment does not depend on the moments asked for before.

    camera: the one that pictures are taken by, as --camera names it. shutter: what is asked for of its settings.
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
        self._last: _Built | None = None
        self._auto: dict[str, Any] | None = None

    def at(self, moment: Moment, say: Say = lambda step: None) -> tuple[CompiledScene, dict[str, Any]]:
        """The compiled scene at a moment, and its summary. say: told what begins now. Raises SceneError.

        The camera that frames a scene without one frames it as it is at its beginning, and then stands still.
        """
        from renderer.scene.compile import summarise
        from renderer.scene.same import compiles_alike

        if self._last is None or self._last.read.moves:
            say("reading")
            read = self._shot.over(moment, self._shutter)
            if self._last is not None and compiles_alike(read, self._last.read):
                self._last = self._last._replace(described=replace(self._last.described, cameras=read.cameras))
            else:
                self._last = None  # two of them need not fit into memory
                say("building")
                untouched = _untouched(read)
                self._last = _Built(untouched, read, self._built(read))
        summary = summarise(self._last.described, self._last.compiled)
        if self._last.read.moves and moment.frame != self._shot.start and self._is_auto(summary["cameras"]):
            if self._auto is None:
                start = self._shot.at(replace(moment, frame=self._shot.start))
                self._auto = summarise(start, self._built(start))["cameras"][-1]
            summary["cameras"][-1] = self._auto
        return self._last.compiled, summary

    def _built(self, description: SceneDescription) -> CompiledScene:
        from renderer.scene.compile import compile_scene

        return compile_scene(description, brute=self._brute, threads=self._threads)

    def _is_auto(self, cameras: list[dict[str, Any]]) -> bool:
        return find_camera(cameras, self._camera) == len(cameras) - 1


def _untouched(description: SceneDescription) -> SceneDescription:
    """A copy that compiling the description leaves as it is: that may add to its lists, and changes nothing in them."""
    held = {f.name: getattr(description, f.name) for f in fields(description)}
    copied: dict[str, Any] = {name: copy(value) for name, value in held.items() if isinstance(value, list | dict)}
    return replace(description, **copied)


@contextlib.contextmanager
def open_stage(
    scene: Path,
    environment: Env,
    variant: str | None = None,
    camera: str | None = None,
    brute: bool = False,
    threads: int | None = None,
    shutter: Mapping[str, Any] = MappingProxyType({}),
) -> Iterator[Stage]:
    """A scene's files, open for as long as frames of it are asked for; brute: without a BVH. threads: None for all cores.

    shutter: what is asked for of its settings.
    """
    from renderer.scene.load import Shot

    with opened(scene, environment.image) as (folder, main, inside):
        if environment.sky is not None:
            inside = "sky:{:g},{:g}".format(*environment.sky)
        yield Stage(Shot(folder, main, inside, variant), camera, brute, threads, shutter)
