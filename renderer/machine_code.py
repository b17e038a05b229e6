"""The on-disk cache of compiled functions: one file per function and signature, named by a hash of both.

Numba's own cache numbers its files and lists them in an index: processes that compile at the same time lose each other's entries,
and the caches of two machines cannot be merged. Here equal names imply equal code.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import inspect
import os
import pickle
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from numba.core.serialize import dumps

from renderer.cache_folders import make_private, read_private, reason_to_distrust
from renderer.linking import restore_compiled
from renderer.sources import ROOT

__all__ = ["SUFFIX", "FunctionCacheFiles", "collect_cache_files", "note_file"]

SUFFIX = ".code"

_noted: set[Path] | None = None


@contextlib.contextmanager
def collect_cache_files() -> Iterator[set[Path]]:
    """Context manager that yields the set of cache files of kernels that any thread of this process reads or writes within it.

    Excludes the files of functions that kernels call: the kernels' files contain their code, and which of them are accessed
    depends on what the process has compiled before.
    """
    global _noted
    files: set[Path] = set()
    _noted = files
    try:
        yield files
    finally:
        _noted = None


def note_file(path: Path) -> None:
    """Adds a cache file to the set that a running `collect_cache_files` has yielded."""
    if _noted is not None:
        _noted.add(path)


class FunctionCacheFiles:
    """The cache of one function (machine code, or bitcode for linking), with the cache interface of Numba's dispatchers.

    folder: returns the cache folder; called at the first use. stamp: a text that names all inputs of the machine code besides the
    function's byte code, its signature and the target. is_kernel: whether Python calls the function, so that
    `collect_cache_files` collects its files.
    """

    def __init__(self, function: Any, folder: Callable[[], Path], stamp: str, is_kernel: bool) -> None:
        self._function = function
        self._folder = folder
        self._stamp = stamp
        self._is_kernel = is_kernel

    @property
    def cache_path(self) -> str:
        """The path of the folder that contains the function's cache files."""
        return str(self._files.folder)

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Returns the function compiled for a signature; None if it is not cached."""
        context.prepare_to_load()
        kept = self._files.load(self._key(signature, context.codegen()))
        return None if kept is None else restore_compiled(context, kept)

    def save_overload(self, signature: Any, result: Any) -> None:
        """Stores a compiled function, unless its code contains addresses of this process."""
        if result.library.has_dynamic_globals:
            return
        self._files.save(self._key(signature, result.codegen), result._reduce())

    def flush(self) -> None:
        """Deletes the function's cache files."""
        self._files.flush()

    @functools.cached_property
    def _files(self) -> _Files:
        path = Path(inspect.getfile(self._function))
        python = f"py{sys.version_info[0]}{sys.version_info[1]}"
        name = f"{path.stem}.{self._function.__qualname__}".replace("<", "").replace(">", "")
        if path.is_relative_to(ROOT):  # its dependencies are in the folder's name, and its name is unique in its module
            module = path.relative_to(ROOT).with_suffix("").as_posix().replace("/", ".")
            return _Files(self._folder() / module, f"{name}-1.{python}", self._stamp, self._is_kernel)
        status = path.stat()
        folder = hashlib.sha256(str(path.parent).encode()).hexdigest()[:16]
        stem = f"{name}-{self._function.__code__.co_firstlineno}.{python}"
        return _Files(self._folder() / f"{path.parent.name}_{folder}", stem, (status.st_mtime, status.st_size), self._is_kernel)

    def _key(self, signature: Any, codegen: Any) -> tuple[Any, Any, Any]:
        closure = self._function.__closure__
        cells = dumps(tuple(cell.cell_contents for cell in closure)) if closure is not None else b""
        hashes = (hashlib.sha256(part).hexdigest() for part in (self._function.__code__.co_code, cells))
        return signature, codegen.magic_tuple(), tuple(hashes)


class _Files:
    """The cache files of one function, one file for each key.

    A key is (signature, target, hashes of the function's byte code and cells).

    stamp: further inputs on which the code depends.
    """

    def __init__(self, folder: Path, stem: str, stamp: Any, is_kernel: bool = True) -> None:
        self.folder = folder
        self._stem = stem
        self._stamp = stamp
        self._is_kernel = is_kernel

    def save(self, key: Any, data: Any) -> None:
        """Stores the data for a key atomically. If it cannot be written, the next process compiles the function again."""
        path = self._path(key)
        try:
            make_private(self.folder)
            if reason_to_distrust(self.folder.stat()):
                return
        except OSError:
            return
        beside = path.with_name(f".part-{os.getpid()}-{threading.get_ident()}-{path.name}")
        try:
            beside.touch(0o600)
            beside.write_bytes(dumps(data))
            beside.replace(path)
        except OSError:
            return
        finally:
            with contextlib.suppress(OSError):
                beside.unlink(missing_ok=True)
        self._note(path)

    def load(self, key: Any) -> Any:
        """Returns the data stored for a key.

        Returns None if the file is missing, damaged, outdated (refers to removed code), or writable by other users.
        """
        path = self._path(key)
        try:
            found = read_private(path)
            if found is None:
                return None
            data = pickle.loads(found)
        except (OSError, EOFError, pickle.UnpicklingError, ImportError, AttributeError):
            return None
        self._note(path)
        return data

    def flush(self) -> None:
        """Deletes the cache files of this function."""
        for path in self.folder.glob(f"{self._stem}.*{SUFFIX}"):
            path.unlink(missing_ok=True)

    def _path(self, key: Any) -> Path:
        signature, *rest = key
        name = hashlib.sha256(repr(([str(t) for t in signature], rest, self._stamp)).encode()).hexdigest()
        return self.folder / f"{self._stem}.{name[:16]}{SUFFIX}"

    def _note(self, path: Path) -> None:
        if self._is_kernel:
            note_file(path)
