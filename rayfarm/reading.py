"""Reads and compiles scenes in a confined process (renderer/confine/), for commands and for `rayfarm.render`."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from rayfarm.options import Env, Placement
from rayfarm.preload import PRELOAD
from rayfarm.reading_files import bounds_of
from rayfarm.scene_files import opened_scene
from renderer.blender.opening import callable_functions
from renderer.confine.job_folder import temporary_folder
from renderer.confine.running import Reader, error_of, run
from renderer.errors import SceneError
from renderer.scene.animation import BETWEEN, Moment, Shutter

if TYPE_CHECKING:
    from renderer.scene.compiled import CompiledScene

__all__ = ["ConfinedScene", "describe", "known_differences", "open_stage", "render_settings"]

Say = Callable[[str], None]


@dataclass(frozen=True)
class _SceneFiles:
    """Locations of a scene's files, as yielded by `opened_scene`."""

    folder: Path
    main: str
    inside: str | None  # the environment image that replaces the scene's


class ConfinedScene:
    """A scene over time, read and compiled in a confined process. Same interface as rayfarm.stage.Stage.

    The process ends when the stage is closed, or if it crashes; then the next moment starts a new process.
    """

    def __init__(self, scene: _SceneFiles, folder: Path, options: Mapping[str, Any]) -> None:
        """Stores the parameters.

        folder: an empty folder for results and temporary files. options: the other arguments of Stage, and `variant`, `up`,
        `floor` and `vary`.
        """
        self._scene, self._room, self._options = scene, folder, options
        self._reader: Reader | None = None
        self._compiled: CompiledScene | None = None
        self.bounds = bounds_of(scene.main)

    def scene_at(self, moment: Moment, say: Say = lambda step: None) -> tuple[CompiledScene, dict[str, Any]]:
        """Returns the compiled scene at a moment, and its summary. say: called with each step when it begins.

        Raises RayfarmError.
        """
        return self._request_scene({"which": "at", "moment": asdict(moment)}, say)

    def between_neighbours(self, moment: Moment, shutter: Shutter = BETWEEN) -> tuple[CompiledScene, dict[str, Any]]:
        """Returns the scene with a shutter that is open from the previous to the next frame, for motion vectors.

        moment: the frame between them. shutter: another time around it. Otherwise like `scene_at`."""
        request = {"which": "between", "moment": asdict(moment), "shutter": asdict(shutter)}
        return self._request_scene(request, lambda step: None)

    def _request_scene(self, request: dict[str, Any], say: Say) -> tuple[CompiledScene, dict[str, Any]]:
        found: dict[str, Any] = {}

        def handle_message(message: dict[str, Any]) -> None:
            if "step" in message:
                say(str(message["step"]))
            else:
                found.update(message)
                if "manifest" in message:
                    self._compiled = _load_compiled_scene(self._room, str(message["manifest"]))

        for _ in range(2):
            if self._reader is None:
                self._reader, self._compiled = self._start_reader(), None
            try:
                if self._reader.request(request, handle_message):
                    break
            finally:
                if self._reader.is_over:
                    self._reader = None
        if "failed" in found:
            raise error_of(found["failed"], self.bounds)
        if self._compiled is None or "summary" not in found:
            raise SceneError(f"{self._scene.main} cannot be read: its importer ended without a result.")
        return self._compiled, found["summary"]

    def _start_reader(self) -> Reader:
        scene, room = self._scene, self._room
        for name in ("temporary", "out"):
            (room / name).mkdir(exist_ok=True)
        from rayfarm.reader_jobs import serve_requests

        work = partial(serve_requests, *_encoded_paths(scene), os.fsencode(room / "out"), dict(self._options))
        writes = [room / "temporary", room / "out"]
        return Reader(work, [scene.folder], writes, self.bounds, PRELOAD, callable_functions(scene.folder, room / "temporary"))

    def close(self) -> None:
        """Ends the confined process."""
        if self._reader is not None:
            self._reader.close()


@contextlib.contextmanager
def open_stage(
    scene: Path,
    environment: Env,
    variant: str | None = None,
    camera: str | None = None,
    brute: bool = False,
    threads: int | None = None,
    shutter: Mapping[str, Any] = MappingProxyType({}),
    root: Path | None = None,
    placement: Placement = Placement(),
    vary: Mapping[str, Any] | None = None,
) -> Iterator[ConfinedScene]:
    """Context manager that opens a scene for rendering its frames.

    brute: without a BVH. threads: None: all cores. shutter: the given shutter settings. camera: as in --camera. root: a folder
    that contains the scene; the scene may refer to all files in it. vary: a variation, as Variation.parse takes it.
    """
    with (
        opened_scene(scene, environment.image, root) as (folder, main, inside),
        temporary_folder("rayfarm-read-", in_memory=True) as room,
    ):
        if environment.sky is not None:
            inside = "sky:{:g},{:g}".format(*environment.sky)
        options: dict[str, Any] = {
            "variant": variant,
            "camera": camera,
            "brute": brute,
            "threads": threads,
            "shutter": dict(shutter),
        }
        options |= {**placement._asdict(), "vary": vary}
        stage = ConfinedScene(_SceneFiles(folder.resolve(), main, environment.preset or inside), room, options)
        try:
            yield stage
        finally:
            stage.close()


def describe(scene: Path, say: Say = lambda step: None, root: Path | None = None) -> dict[str, Any]:
    """Returns the summary that `rayfarm info` shows, with the scene's `name` and `main` file. Raises RayfarmError.

    root: a folder that contains the scene; the scene may refer to all files in it.
    """
    from rayfarm.reader_jobs import describe_scene as work

    with opened_scene(scene, root=root) as (folder, main, _), temporary_folder("rayfarm-read-") as room:
        found = _SceneFiles(folder.resolve(), main, None)
        job = partial(work, *_encoded_paths(found)[:2])
        calls = callable_functions(found.folder, room)
        return run(job, [found.folder], [room], bounds_of(main), lambda message: say(str(message["step"])), PRELOAD, calls)


def render_settings(scene: Path, first: int | None, count: int, step: int, root: Path | None = None) -> dict[str, Any]:
    """Returns the render settings of a USD file, as `describe_render_settings` does. Raises RayfarmError."""
    from rayfarm.reader_jobs import usd_render_settings as work

    with opened_scene(scene, root=root) as (folder, main, _), temporary_folder("rayfarm-read-") as room:
        found = _SceneFiles(folder.resolve(), main, None)
        job = partial(work, *_encoded_paths(found)[:2], first, count, step)
        return run(job, [found.folder], [room], bounds_of(main), preload=PRELOAD)


def known_differences(scene: Path, other: str) -> list[str]:
    """Returns sentences on why another renderer's picture of a scene differs from Rayfarm's. Raises RayfarmError."""
    from rayfarm.reader_jobs import explain_differences

    with temporary_folder("rayfarm-read-") as room:
        job = partial(explain_differences, os.fsencode(scene.parent.resolve()), os.fsencode(scene.name), other)
        found = run(job, [scene.parent.resolve()], [room], bounds_of(scene.name), preload=PRELOAD)
    return [str(each) for each in found["sentences"]]


def _encoded_paths(scene: _SceneFiles) -> tuple[bytes, bytes, bytes | None]:
    """Returns the scene's paths as bytes, since the confined process may use another encoding for paths."""
    return os.fsencode(scene.folder), os.fsencode(scene.main), None if scene.inside is None else os.fsencode(scene.inside)


def _load_compiled_scene(folder: Path, manifest: str) -> CompiledScene:
    """Loads the scene that the confined process wrote. Copies it, so that the process cannot change it after validation."""
    from renderer.arrays.scene import flat, nested, seal
    from renderer.scene.compiled import load

    mapped = flat(load(folder / "out" / Path(manifest).name))
    return seal(nested({name: array.copy() for name, array in mapped.items()}))
