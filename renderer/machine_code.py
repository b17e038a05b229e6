"""Where Numba keeps what it has compiled: a file for each function and signature, under a name that follows from both.

Numba's own cache numbers its files and lists them in an index. Two processes that compile at the same time lose each other's
entries there, and what two machines compiled cannot be laid in one folder: here the same name is the same code.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import pickle
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from numba.core.caching import CompileResultCacheImpl, FunctionCache
from numba.core.serialize import dumps

from renderer.linking import rebuilt
from renderer.places import distrust, make_private, read_private

__all__ = ["SUFFIX", "Kept", "noted"]

SUFFIX = ".code"

_noted: set[Path] | None = None


@contextlib.contextmanager
def noted() -> Iterator[set[Path]]:
    """The files of kernels that are read or written meanwhile, by any thread of this process.

    Not those of the functions that kernels are made of: their code is in the kernels', and which of them are looked at depends on
    what the process has compiled before.
    """
    global _noted
    files: set[Path] = set()
    _noted = files
    try:
        yield files
    finally:
        _noted = None


class _Results(CompileResultCacheImpl):
    """Numba's, but for the functions that only others of ours call."""

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """The function, out of what was kept of it."""
        return rebuilt(target_context, payload) or super().rebuild(target_context, payload)


class Kept(FunctionCache):
    """A function's machine code. Numba's, but for the files.

    is_kernel: whether Python calls it, so that it is `noted`.
    """

    _impl_class = _Results

    def __init__(self, function: Any, is_kernel: bool) -> None:
        super().__init__(function)
        stamp = self._impl.locator.get_source_stamp()
        self._cache_file = _Files(Path(self.cache_path), self._impl.filename_base, stamp, is_kernel)


class _Files:
    """What FunctionCache asks of its files. A key is (signature, target, hashes of the function's byte code and cells).

    stamp: what else the code depends on.
    """

    def __init__(self, folder: Path, stem: str, stamp: Any, is_kernel: bool = True) -> None:
        self._folder = folder
        self._stem = stem
        self._stamp = stamp
        self._is_kernel = is_kernel

    def save(self, key: Any, data: Any) -> None:
        """Keep it, whole or not at all: where it cannot be written, the next process compiles it again."""
        path = self._path(key)
        try:
            make_private(self._folder)
            if distrust(self._folder.stat()):
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
        """What was kept, or None. A file counts as none that a power cut left damaged, that names what is no more, or that other
        users may have written.
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
        """Forget what is kept of this function."""
        for path in self._folder.glob(f"{self._stem}.*{SUFFIX}"):
            path.unlink(missing_ok=True)

    def _path(self, key: Any) -> Path:
        signature, *rest = key
        name = hashlib.sha256(repr(([str(t) for t in signature], rest, self._stamp)).encode()).hexdigest()
        return self._folder / f"{self._stem}.{name[:16]}{SUFFIX}"

    def _note(self, path: Path) -> None:
        if _noted is not None and self._is_kernel:
            _noted.add(path)
