"""Runs confined readers (renderer/confine/) for a slot. Creates their folders, sets their limits, and converts their errors.

A reader's folder is temporary: `scene`, `base` and other folders that the slot puts there are read-only; `out` and `temporary`
are writable. A reader's answers are untrusted: names and values are checked here, blobs by their hash when they are stored.
"""

from __future__ import annotations

import contextlib
import os
import re
import stat
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Self

from renderer import errors as faults
from renderer import jit
from renderer.blender.opening import callable_functions
from renderer.confine import running
from renderer.confine.job_folder import temporary_folder
from renderer.confine.reader import Link
from renderer.confine.running import Bounds
from renderer.render import FULL, kernel_name, warm_up
from renderer.scene.compiled_parts import parts_of
from renderer.sentences import Sentence
from worker.exchange.errors import UnfitError, WorkError
from worker.process.context import WorkerContext
from worker.work.files import link_or_copy, memory_budget
from worker.work.scenes import open_scene

__all__ = ["ReaderFolder", "begin_launcher", "has_plain_kernel", "translated_errors"]

Send = Callable[[dict[str, Any]], None]
Job = Callable[[Link], dict[str, Any]]

_READERS = ("collada", "fbx", "gltf", "mitsuba", "obj", "pbrt", "ply", "stl", "yaml")
_JOBS = ("prepare", "thumbnail", "frames", "relight", "vectors", "environments", "denoise")
_PRELOAD = (
    *(f"renderer.scene.readers.{name}" for name in _READERS),
    *(f"worker.reading.{name}" for name in _JOBS),
    # Kernels of readers, which those import only for files of their format.
    *("renderer.scene.readers.obj_lines", "renderer.scene.readers.threemf_rows", "renderer.scene.readers.gltf.deform"),
    "renderer.scene.readers.usd:load",
)
_PLAIN_KERNEL = "worker.reading.kernels:load"
_ALL_PREPARING = "renderer.preparation_kernels:prepare"
_PLAIN_NAME = re.compile(r"[0-9A-Za-z][0-9A-Za-z_.-]{0,99}")
_MAX_MANIFEST_BYTES = 64 << 20  # bytes


def begin_launcher() -> None:
    """Starts the launcher that forks readers for this process and its children. Raises UnfitError."""
    with translated_errors():
        running.begin_launcher(_preload())


def has_plain_kernel() -> bool:
    """Returns True if the plain kernel, and with it the kernels that prepare scenes, are in this machine's cache."""
    return jit.is_cached(kernel_name())


def _preload() -> list[str]:
    """Returns what the launcher loads before it forks a reader: of the kernels those that are cached.

    While it waited for others to be compiled, no scene could be read.
    """
    plain = [_PLAIN_KERNEL] if has_plain_kernel() else []
    preparing = [_ALL_PREPARING] if jit.is_cached(kernel_name(variant=FULL)) else []
    return [*_PRELOAD, *plain, *preparing]


@contextlib.contextmanager
def translated_errors() -> Iterator[None]:
    """Context manager that converts the renderer's errors: limits of this machine to UnfitError, all others to WorkError."""
    try:
        yield
    except faults.MachineError as error:
        raise UnfitError(str(error)) from error
    except faults.RayfarmError as error:
        raise WorkError(str(error)) from error


class ReaderFolder:
    """Temporary folder of one reader, as a context manager that deletes it. Raises UnfitError if it cannot be created."""

    def __init__(self, name: str) -> None:
        self._kept = contextlib.ExitStack()
        with translated_errors():
            self.folder = self._kept.enter_context(temporary_folder(f"rayfarm-{name}-"))
        self.scene, self.base, self.out, self._temporary = (self.folder / part for part in ("scene", "base", "out", "temporary"))
        for folder in (self.scene, self.base, self.out, self._temporary):
            folder.mkdir()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Deletes the folder."""
        self._kept.close()

    def place_base(self, worker: WorkerContext, sha256: str) -> None:
        """Links a compiled scene from the cache, with its parts, into the folder `base`.

        Raises TemporaryError, RefusedError and SceneError.
        """
        open_scene(worker.cache, sha256)  # fetches and validates it
        manifest = worker.cache.path(sha256)
        for path in (manifest, *(worker.cache.path(*part) for part in parts_of(manifest))):
            link_or_copy(path, self.base / path.name)

    def run(
        self,
        job: Job,
        subject: str,
        seconds: float,
        on_message: Send = lambda message: None,
        *,
        memory: int | None = None,
        preload: Sequence[str] = (),
        calls: Mapping[str, Callable[..., Any]] | None = None,
        reads: Sequence[Path] = (),
        needs_kernels: bool = True,
    ) -> dict[str, Any]:
        """Runs a job in a reader and returns its answer; see renderer.confine.running.Reader. Raises WorkError and UnfitError.

        subject: name of the file for error messages. seconds: time limit. on_message: called with each message of
        the job. memory: limit in bytes; None: the worker's budget. preload: modules to import before the job starts, or
        "module:function" to call. calls: functions of this process that the reader may call, by name. reads: other folders that
        the reader may read. needs_kernels: False for a job that begins without kernels; for others they are compiled first,
        since a reader cannot store what it compiles.
        """
        with (
            translated_errors(),
            self.begin_reader(
                job,
                subject,
                seconds,
                memory=memory,
                preload=preload,
                calls=calls,
                reads=reads,
                needs_kernels=needs_kernels,
            ) as reader,
        ):
            return reader.result(on_message)

    def begin_reader(
        self,
        job: Job,
        subject: str,
        seconds: float,
        *,
        memory: int | None = None,
        preload: Sequence[str] = (),
        calls: Mapping[str, Callable[..., Any]] | None = None,
        reads: Sequence[Path] = (),
        needs_kernels: bool = True,
    ) -> running.Reader:
        """Starts a reader with the job. Parameters as for `run`. Raises UnfitError."""
        bounds = Bounds(
            memory_budget() if memory is None else memory,
            seconds,
            subject,
            Sentence("memory-granted-to-scene", "that this worker grants one scene"),
            Sentence("advice-shrink-or-split", "Make it smaller, or split it into several."),
        )
        if needs_kernels and not has_plain_kernel():
            warm_up()
        calls = {**callable_functions(self.scene, self.folder), **(calls or {})}
        with translated_errors():
            return running.Reader(
                job,
                [self.scene, self.base, *reads],
                [self._temporary, self.out],
                bounds,
                [*_preload(), *preload],
                calls,
            )

    def result(self, name: Any) -> Path:
        """Returns the path in `out` of a file named by the reader; the name may contain `/`.

        Raises WorkError unless it is a regular file.
        """
        path = self.out
        for part in str(name).split("/"):
            if not _PLAIN_NAME.fullmatch(part) or path.is_symlink():
                raise WorkError(
                    Sentence(
                        "reader-file-name-invalid",
                        "the scene's reader gave an invalid file name: {name}",
                        name=repr(str(name)[:100]),
                    )
                )
            path /= part
        if not self.has_file(path):
            raise WorkError(
                Sentence("reader-file-missing", "the scene's reader wrote no file {name}", name=repr(str(name)[:100]))
            )
        return path

    @staticmethod
    def has_file(path: Path) -> bool:
        """Returns True if `path` is a regular file."""
        try:
            return stat.S_ISREG(path.lstat().st_mode)
        except OSError:
            return False

    def compiled(self, name: Any) -> Path:
        """Returns the path of a compiled scene's manifest named by the reader. Its parts are in the same folder or in the cache.

        Raises WorkError.
        """
        path = self.result(name)
        if path.stat().st_size > _MAX_MANIFEST_BYTES:
            raise WorkError(
                Sentence(
                    "reader-manifest-too-large", "the scene's reader wrote a manifest of {bytes} bytes", bytes=path.stat().st_size
                )
            )
        with translated_errors():
            for part in parts_of(path):
                beside = path.parent / part.sha256
                if os.path.lexists(beside) and not self.has_file(beside):
                    raise WorkError(
                        Sentence(
                            "reader-part-not-file",
                            "the scene's reader wrote a part that is not a file: {sha256}",
                            sha256=part.sha256,
                        )
                    )
        return path
