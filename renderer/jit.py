"""The one owner of every compiler option, of the machine that kernels are compiled for, and of the folder that keeps them.

Import this before numba: it pins the target. A film adds up samples of many hosts and must not depend on which, so all Intel and
AMD hosts are one kind (`kind`): they compile for x86-64-v3, or, where the processor has it, for AVX-512, whose more registers,
masks and byte operations give the same bits sooner (tests/renderer/test_same_bits.py). ARM hosts compile for their own baseline
and are a kind of their own, whose films never mix with the others'.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
import gc
import hashlib
import os
import platform
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from importlib.metadata import version
from pathlib import Path
from typing import IO, Any, ClassVar

import llvmlite.binding as llvm  # which has nothing of Numba's options

from renderer import __version__, sources
from renderer.places import make_private, private_folder
from renderer.without import without

__all__ = [
    "HAS_AVX512",
    "TARGET",
    "KeptByMeaning",
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
_X86 = ("x86_64", "amd64")
_ARM = ("aarch64", "arm64")
_V3 = ("avx2", "fma", "bmi", "bmi2", "lzcnt", "movbe", "f16c")
_AVX512 = ("avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl", "avx512vbmi", "gfni")


def _target() -> tuple[str, str, str]:
    """This host's target: its name in a kind, LLVM's name of the CPU, and what that is to use beyond.

    AVX-512 as Intel has it since Ice Lake and AMD since Zen 4, unless $RAYFARM_AVX512 is false: processors before these slow down
    for it.
    """
    machine = platform.machine().lower()
    if machine not in _X86:
        return ("aarch64" if machine in _ARM else machine), "generic", ""
    has = llvm.get_host_cpu_features()
    if lacks := [name for name in _V3 if not has.get(name)]:
        raise RuntimeError(
            f"This processor lacks {', '.join(lacks)}. Rayfarm's kernels need x86-64-v3: Intel since 2013, AMD since 2017."
        )
    wanted = os.environ.get("RAYFARM_AVX512", "true").lower() not in ("false", "0", "no", "off")
    if wanted and all(has.get(name) for name in _AVX512):
        return "x86-64-v3", "x86-64-v4", "+avx512vbmi,+gfni"
    return "x86-64-v3", "x86-64-v3", ""


TARGET, _CPU, _MORE = _target()
HAS_AVX512 = _CPU == "x86-64-v4"


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
_MACHINE_CODE = _hash(_MEANING, _CPU, _MORE)


@functools.cache
def kind() -> str:
    """Which films this worker's samples may be added to, e.g. "0.1.0-3fa9c1d2-x86-64-v3". Safe in a queue's name.

    It follows from all that decides machine code and the arrays that it reads, and from nothing else.
    """
    both = _hash(_MEANING, _meaning("arrays", sources.ARRAYS))
    return f"{__version__}-{both[:8]}-{TARGET}"


def cache_folder() -> Path:
    """Where the machine code is kept: $RAYFARM_CACHE/kernels/<hash>, by default under ~/.cache/rayfarm.

    Where others may write there, a private folder (renderer/places.py).

    Numba looks at the age of one function's file only, so a change in a function that it calls would go unseen: hence a
    folder of its own for each state of the sources.
    """
    return private_folder(f"kernels/{_MACHINE_CODE[:16]}")


def _configure() -> None:
    settings = {
        "NUMBA_CPU_NAME": _CPU,
        "NUMBA_CPU_FEATURES": _MORE,
        "NUMBA_CACHE_DIR": str(cache_folder()),
        "NUMBA_CACHE_LOCATOR_CLASSES": "renderer.jit.KeptByMeaning,UserProvidedCacheLocator",
        # What is to be SIMD here says so itself. LLVM's own search for it, and its third level of optimisation, take a fifth of
        # the time that a cold kernel takes, and make none faster (measured).
        "NUMBA_LOOP_VECTORIZE": "0",
        "NUMBA_OPT": "2",
    }
    os.environ.update(settings)
    if "numba" in sys.modules:  # too late for the environment, in time for what is compiled from here on
        from numba.core import config

        config.reload_config()


_configure()

from llvmlite import ir  # noqa: E402

with without("scipy"):
    from numba import njit, types
from numba.core import cgutils  # noqa: E402
from numba.core.caching import UserProvidedCacheLocator  # noqa: E402
from numba.extending import intrinsic  # noqa: E402
from numba.np.arrayobj import populate_array  # noqa: E402

import renderer.quicker  # noqa: E402
import renderer.unasked  # noqa: E402, F401
from renderer.absent import Compiler  # noqa: E402
from renderer.linking import stay_apart  # noqa: E402
from renderer.machine_code import Kept, noted  # noqa: E402

# No nnan/ninf: they delete the NaN checks that the film relies on. No arcp/afn: they let LLVM use rcpps and rsqrtps, whose
# low bits differ between Intel and AMD. `contract` forms fused multiply-adds, which every target of ours has.
_FASTMATH = {"contract", "nsz"}

Function = Callable[..., Any]


class KeptByMeaning(UserProvidedCacheLocator):
    """Where Numba keeps what is compiled from our sources: by their meaning alone (renderer/sources.py), which is in the folder's
    name. Neither a comment nor another checkout compiles anything anew; a file's age says nothing.

    Functions that are not ours, those of tests, are left to the next locator.
    """

    _of_modules: ClassVar[dict[tuple[str, str | None], KeptByMeaning | None]] = {}

    def __init__(self, py_func: Any, py_file: str) -> None:
        self._name = Path(py_file).relative_to(sources.ROOT).with_suffix("").as_posix().replace("/", ".")
        self._cache_path = str(cache_folder() / self._name)

    def ensure_cache_path(self) -> None:
        """Does nothing. Numba's writes a file to find out whether it can, and fails in a folder that can only be read; `Kept`
        makes the folders that it writes to, and does without where it cannot.
        """

    def get_source_stamp(self) -> str:
        """The same for all that lies in the folder."""
        return _MACHINE_CODE

    def get_disambiguator(self) -> str:
        """Names in a module of ours are unique."""
        return "1"

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> KeptByMeaning | None:
        """The locator, or None for a function that is not ours."""
        key = py_file, os.environ.get("RAYFARM_CACHE")
        if key not in cls._of_modules:  # looked for once for all functions of a module
            cls._of_modules[key] = cls(py_func, py_file) if Path(py_file).is_relative_to(sources.ROOT) else None
        return cls._of_modules[key]


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
        "fastmath": _FASTMATH,
        "error_model": "numpy",
        "_nrt": heap,
        "forceinline": inline,
        # To take arguments from Python, a scene's forty arrays above all, costs two fifths of the compiler's time (measured).
        "no_cpython_wrapper": not from_python,
        "no_cfunc_wrapper": True,
        "pipeline_class": Compiler,
    }
    made = njit(**options)(function)
    made._cache = Kept(function, from_python)
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
    return njit(inline="always", pipeline_class=Compiler)(function)


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
