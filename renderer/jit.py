"""All compiler options of kernels, and the cache folder of their machine code.

Kernels have a separate compile target (renderer/target.py): importing this module changes nothing for a program's other Numba
code.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
import hashlib
import os
import time
from collections.abc import Callable, Iterable, Iterator
from importlib.metadata import version
from pathlib import Path
from typing import IO, Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import populate_array

from renderer import __version__, cpu, sources
from renderer.cache_folders import make_private, private_folder
from renderer.cpu import HAS_AVX512, TARGET
from renderer.linking import mark_never_inlined
from renderer.machine_code import FunctionCacheFiles, collect_cache_files
from renderer.prune_absent_features import Compiler
from renderer.target import KernelDispatcher

__all__ = [
    "HAS_AVX512",
    "TARGET",
    "builder",
    "cache_folder",
    "compiling",
    "device",
    "entry",
    "is_cached",
    "is_ready",
    "kind",
    "local_floats",
    "never_inline",
    "subroutine",
    "template",
]

COMPILE_PATIENCE_S = 300.0


def _source_hash(name: str, parts: Iterable[str]) -> str:
    """Returns a hash of these sources that ignores comments and docstrings (renderer/sources.py).

    The hash is cached next to Python's byte code, or in this user's cache, but not in the kernel cache. A hash that another user,
    such as the build of a container image, has stored for all users is used too.
    """
    beside, file = sources.ROOT / "__pycache__", f"{name}.meaning"
    folder = beside if os.access(beside, os.W_OK) or (beside / file).is_file() else private_folder("sources")
    return sources.cached_meaning(sources.files_of(parts), folder / file)


def _hash(*parts: str) -> str:
    """Returns the hash that names the kernel cache folder; it covers the sources' meaning, the compiler and the target."""
    return hashlib.sha256(f"{' '.join(parts)} {version('numba')} {version('llvmlite')} {TARGET}".encode()).hexdigest()


_MEANING = _source_hash("machine-code", sources.MACHINE_CODE)
_MACHINE_CODE = _hash(_MEANING, cpu.NAME, cpu.FEATURES)


@functools.cache
def kind() -> str:
    """Returns the identifier of the films to which this worker's samples may be added, e.g. "0.1.0-3fa9c1d2-x86-64-v3".

    Depends on exactly those inputs that determine the machine code and the arrays that it reads. Can be used in a queue's name.
    """
    both = _hash(_MEANING, _source_hash("arrays", sources.ARRAYS))
    return f"{__version__}-{both[:8]}-{TARGET}"


def cache_folder() -> Path:
    """Returns the folder of the machine code: $RAYFARM_CACHE/kernels/<hash>, by default under ~/.cache/rayfarm.

    If other users can write to that folder, a private folder is used instead (renderer/cache_folders.py).

    Numba checks the modification time of one function's file only and would miss a change in a function that it calls. Therefore
    each state of the sources has a separate folder.
    """
    return private_folder(f"kernels/{_MACHINE_CODE[:16]}")


Function = Callable[..., Any]


@intrinsic
def never_inline(typingctx: Any) -> Any:
    """Marks the calling subroutine as never inlined, however small, so that its registers are allocated separately."""

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.function.attributes.add("noinline")
        mark_never_inlined(context.active_code_library)
        return context.get_dummy_value()

    return types.void(), codegen


@intrinsic(prefer_literal=True)
def local_floats(typingctx: Any, count: Any) -> Any:
    """Returns an array of `count` float32 on the stack, valid until the calling function returns. count: a literal.

    The array is not initialised. It may be passed to subroutines, but never returned.
    """
    array = types.Array(types.float32, 1, "C")
    length = count.literal_value

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        word = context.get_value_type(types.float32)
        memory = cgutils.alloca_once(builder, ir.ArrayType(word, length))
        size = context.get_constant(types.intp, length)
        item = context.get_constant(types.intp, 4)
        view = context.make_array(array)(context, builder)
        first = builder.bitcast(memory, word.as_pointer())
        populate_array(view, data=first, shape=[size], strides=[item], itemsize=item, meminfo=None)
        return view._getvalue()

    return array(count), codegen


def _compiled(function: Function, *, heap: bool, inline: bool, from_python: bool = True) -> Function:
    # All options are explicit: a missing one would be inherited from whichever caller is compiled first.
    options: Any = {
        "nogil": True,
        # IEEE 754 as written: every operation is rounded separately, except products that renderer/fused_multiply_add.py
        # fuses.
        "fastmath": False,
        "error_model": "numpy",
        "_nrt": heap,
        "forceinline": inline,
        # Unpacking arguments from Python, mainly a scene's forty arrays, takes two fifths of the compile time (measured).
        "no_cpython_wrapper": not from_python,
        "no_cfunc_wrapper": True,
    }
    made = KernelDispatcher(function, targetoptions={"nopython": True, "boundscheck": None, **options}, pipeline_class=Compiler)
    made.keep_in(FunctionCacheFiles(function, cache_folder, _MACHINE_CODE, is_kernel=from_python))
    return made


def entry(function: Function) -> Function:
    """Declares a kernel that Python calls: compiled once per signature, cached on disk, run without the GIL.

    Kernels have no heap: code that allocates does not compile, and arrays are not reference-counted, since that would take two
    thirds of a path tracer's time (measured).
    """
    return _compiled(function, heap=False, inline=False)


def builder(function: Function) -> Function:
    """Declares a kernel like `entry` for code that prepares scenes, which may allocate scratch space."""
    return _compiled(function, heap=True, inline=False)


def device(function: Function) -> Function:
    """Declares a function that kernels call and that is always inlined into its caller.

    If the function were called out of line, a scene's arrays would be pushed on the stack field by field, two hundred words per
    call. It is cached on disk too, so that further kernels load it typed and optimised. It must not be called from Python: such a
    call would crash. Tests call an `entry` that calls it.
    """
    return _compiled(function, heap=False, inline=True, from_python=False)


def template(function: Function) -> Function:
    """Declares a device function that is inlined into each caller before type inference, for the largest functions.

    None of them is compiled twice, their arguments may be kernels, and branches that depend on an argument that is None are
    removed.
    """
    return KernelDispatcher(
        function, targetoptions={"nopython": True, "boundscheck": None, "inline": "always"}, pipeline_class=Compiler
    )


def subroutine(function: Function) -> Function:
    """Declares a device function that is not inlined if it is large: for code that runs rarely or has many call sites."""
    return _compiled(function, heap=False, inline=False, from_python=False)


_ready: set[str] = set()


def is_ready(name: str) -> bool:
    """Returns True if `compiling` has run for the kernel of that name, in this process or in the one from which it was forked."""
    return name in _ready


def is_cached(name: str) -> bool:
    """Returns True if the kernel of that name is in this machine's cache, compiled here or fetched."""
    return (cache_folder() / f"{name}.done").exists()


@contextlib.contextmanager
def compiling(name: str, fetch: Callable[[], None] | None = None) -> Iterator[bool]:
    """Context manager for the first call of a kernel: one process of this machine compiles it, the others wait and load it.

    Yields True if this process has to compile the kernel. fetch: called by that process before it compiles; may copy machine code
    from another host into the folder. `<name>.done` lists the files of the kernel, for processes that distribute it.

    Otherwise 64 slots would compile the same kernel 64 times at once, each with the memory for it. A process that waits in
    vain, because the compiling one is stopped or the file system has no locks, compiles too.
    """
    folder = cache_folder()
    done = folder / f"{name}.done"
    with _lock(folder / f"{name}.lock") as lock:
        deadline = time.monotonic() + COMPILE_PATIENCE_S
        while not done.exists() and not _try_lock(lock) and time.monotonic() < deadline:
            time.sleep(0.1)
        if fetch is not None and not done.exists():
            fetch()
        with collect_cache_files() as files:
            yield not done.exists()
        with contextlib.suppress(OSError):  # read-only folder: the next process compiles what is missing
            _add_to_list(done, {path.relative_to(folder).as_posix() for path in files})
    _ready.add(name)


def _add_to_list(done: Path, names: set[str]) -> None:
    """Adds names to the list file `done`; creates it if missing."""
    known = set(done.read_text().split()) if done.exists() else None
    if known is None or names - known:
        beside = done.with_name(f".part-{os.getpid()}-{done.name}")
        beside.write_text("".join(f"{name}\n" for name in sorted(names | (known or set()))))
        beside.replace(done)


@contextlib.contextmanager
def _lock(path: Path) -> Iterator[IO[bytes] | None]:
    """Context manager that opens the lock file; yields None in a read-only folder."""
    with contextlib.ExitStack() as stack:
        lock = None
        with contextlib.suppress(OSError):
            make_private(path.parent)
            lock = stack.enter_context(path.open("wb"))
        yield lock


def _try_lock(lock: IO[bytes] | None) -> bool:
    """Tries to take a file lock; returns False if another process holds it, else True, also where there are no file locks."""
    if lock is None:
        return True
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return True  # this platform has no file locks
    return True
