"""The one owner of every compiler option, and of the folder that keeps kernels.

Kernels have a compile target of their own (renderer/target.py): importing this changes nothing for other users of Numba.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
import gc
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
from renderer.linking import stay_apart
from renderer.machine_code import MachineCode, noted
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
    "is_kept",
    "is_ready",
    "kind",
    "local_floats",
    "out_of_line",
    "rare_collections",
    "subroutine",
    "template",
]

COMPILE_PATIENCE_S = 300.0


def _meaning(name: str, parts: Iterable[str]) -> str:
    """What these sources mean: kept beside the files that Python compiles them to, so that no new cache has to find it; also
    where another user has kept it there for all, as an image does."""
    beside, file = sources.ROOT / "__pycache__", f"{name}.meaning"
    folder = beside if os.access(beside, os.W_OK) or (beside / file).is_file() else private_folder("sources")
    return sources.kept_meaning(sources.files_of(parts), folder / file)


def _hash(*parts: str) -> str:
    """Of what sources mean, of the compiler and of the target."""
    return hashlib.sha256(f"{' '.join(parts)} {version('numba')} {version('llvmlite')} {TARGET}".encode()).hexdigest()


_MEANING = _meaning("machine-code", sources.MACHINE_CODE)
_MACHINE_CODE = _hash(_MEANING, cpu.NAME, cpu.FEATURES)


@functools.cache
def kind() -> str:
    """Which films this worker's samples may be added to, e.g. "0.1.0-3fa9c1d2-x86-64-v3". Safe in a queue's name.

    It follows from all that decides machine code and the arrays that it reads, and from nothing else.
    """
    both = _hash(_MEANING, _meaning("arrays", sources.ARRAYS))
    return f"{__version__}-{both[:8]}-{TARGET}"


def cache_folder() -> Path:
    """Where the machine code is kept: $RAYFARM_CACHE/kernels/<hash>, by default under ~/.cache/rayfarm.

    Where others may write there, a private folder (renderer/cache_folders.py).

    Numba looks at the age of one function's file only, so a change in a function that it calls would go unseen: hence a
    folder of its own for each state of the sources.
    """
    return private_folder(f"kernels/{_MACHINE_CODE[:16]}")


Function = Callable[..., Any]


@intrinsic
def out_of_line(typingctx: Any) -> Any:
    """Called in a subroutine's body: it is never merged into its callers, however small, so that its registers are its own."""

    def codegen(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        builder.function.attributes.add("noinline")
        stay_apart(context.active_code_library)
        return context.get_dummy_value()

    return types.void(), codegen


@intrinsic(prefer_literal=True)
def local_floats(typingctx: Any, count: Any) -> Any:
    """An array of `count` float32, a literal, on the machine's stack: it lives as long as the function that calls this.

    Not zeroed. It may be handed down to subroutines, never returned.
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
    # Every option is said aloud: one left out is taken over from whichever caller happens to be compiled first.
    options: Any = {
        "nogil": True,
        # IEEE 754 as written: every operation is rounded by itself, but for the products that renderer/fused_multiply_add.py
        # fuses.
        "fastmath": False,
        "error_model": "numpy",
        "_nrt": heap,
        "forceinline": inline,
        # To take arguments from Python, a scene's forty arrays above all, costs two fifths of the compiler's time (measured).
        "no_cpython_wrapper": not from_python,
        "no_cfunc_wrapper": True,
    }
    made = KernelDispatcher(function, targetoptions={"nopython": True, "boundscheck": None, **options}, pipeline_class=Compiler)
    made.keep_in(MachineCode(function, cache_folder, _MACHINE_CODE, is_kernel=from_python))
    return made


def entry(function: Function) -> Function:
    """A kernel that Python calls: compiled once per signature, kept on disk, run without the GIL.

    Kernels have no heap: what allocates does not compile, and arrays are not counted, which would take two thirds of a
    path tracer's time (measured).
    """
    return _compiled(function, heap=False, inline=False)


def builder(function: Function) -> Function:
    """As `entry`, for code that prepares scenes: it may allocate its scratch space."""
    return _compiled(function, heap=True, inline=False)


def device(function: Function) -> Function:
    """A function for kernels to call, always merged into its caller.

    Called out of line, a scene's arrays would be pushed on the stack field by field, two hundred words a call. Kept on disk
    too, so that every further kernel finds it typed and optimised. It has no door to Python: a call from there would crash;
    tests call an `entry` that calls it.
    """
    return _compiled(function, heap=False, inline=True, from_python=False)


def template(function: Function) -> Function:
    """A device function that is written into each caller before anything is compiled.

    For the largest: nothing of them is compiled twice, arguments may be kernels, and what depends on an argument that is
    None is left out where it is.
    """
    return KernelDispatcher(
        function, targetoptions={"nopython": True, "boundscheck": None, "inline": "always"}, pipeline_class=Compiler
    )


def subroutine(function: Function) -> Function:
    """A device function that stays one, if it is large: for code that is seldom run, or called in many places."""
    return _compiled(function, heap=False, inline=False, from_python=False)


_ready: set[str] = set()


def is_ready(name: str) -> bool:
    """Whether this process, or the one that it was forked from, has been in `compiling` with that name."""
    return name in _ready


def is_kept(name: str) -> bool:
    """Whether this machine has compiled a kernel of that name, or fetched it."""
    return (cache_folder() / f"{name}.done").exists()


@contextlib.contextmanager
def compiling(name: str, fetch: Callable[[], None] | None = None) -> Iterator[bool]:
    """Around the first call of a kernel of that name: of a machine's processes one compiles it, the others wait and load it.
    Gives whether it has to be compiled.

    fetch: called by the one, before it compiles; it may put machine code from elsewhere into the folder. `<name>.done` lists the
    files that it is loaded from, for those that hand it on.

    A slot for each of 64 cores would otherwise compile the same kernel 64 times at once, and take the memory for it. Who waits
    in vain, because the one is stopped or the file system has no locks, compiles too.
    """
    folder = cache_folder()
    done = folder / f"{name}.done"
    with _lock(folder / f"{name}.lock") as lock:
        deadline = time.monotonic() + COMPILE_PATIENCE_S
        while not done.exists() and not _is_taken(lock) and time.monotonic() < deadline:
            time.sleep(0.1)
        if fetch is not None and not done.exists():
            fetch()
        with noted() as files, contextlib.nullcontext() if done.exists() else rare_collections():
            yield not done.exists()
        with contextlib.suppress(OSError):  # a folder that can only be read: the next process compiles what is not there
            _list(done, {path.relative_to(folder).as_posix() for path in files})
    _ready.add(name)


@contextlib.contextmanager
def rare_collections() -> Iterator[None]:
    """While much is compiled: Python's garbage collector, which finds little of it, takes a twelfth of that time (measured)."""
    known = gc.get_threshold()
    gc.set_threshold(200_000, 20, 100)
    try:
        yield
    finally:
        gc.set_threshold(*known)


def _list(done: Path, names: set[str]) -> None:
    """Add the names to the list, and make it where there is none."""
    known = set(done.read_text().split()) if done.exists() else None
    if known is None or names - known:
        beside = done.with_name(f".part-{os.getpid()}-{done.name}")
        beside.write_text("".join(f"{name}\n" for name in sorted(names | (known or set()))))
        beside.replace(done)


@contextlib.contextmanager
def _lock(path: Path) -> Iterator[IO[bytes] | None]:
    """The lock's file; None in a folder that can only be read."""
    with contextlib.ExitStack() as stack:
        lock = None
        with contextlib.suppress(OSError):
            make_private(path.parent)
            lock = stack.enter_context(path.open("wb"))
        yield lock


def _is_taken(lock: IO[bytes] | None) -> bool:
    """Take the lock; False where another process has it."""
    if lock is None:
        return True
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return True  # there are no locks here
    return True
