"""Sandboxes this process with features of the operating system's kernel: Landlock for files, seccomp for system calls.

Also drops its capabilities. Uses the standard library only: the module is also run by a plain Python that then becomes Blender
(renderer/blender/confined.py).
"""

from __future__ import annotations

import ctypes
import errno
import os
import platform
import signal
import struct
import sys
from collections.abc import Iterable
from pathlib import Path

from renderer.confine.syscalls import CLONE_3, DENIED, THREADS, TO_ITSELF

__all__ = [
    "ALL",
    "READ",
    "RUN",
    "WRITE",
    "available_features",
    "die_with_parent",
    "drop_capabilities",
    "enter_empty_network",
    "filter_calls",
    "forbid_new_privileges",
    "restrict_files",
]

# Landlock's system calls have one number on all processors (Linux 5.13).
_CREATE, _ADD_RULE, _RESTRICT = 444, 445, 446
_VERSION, _PATH_BENEATH = 1, 1
_RIGHTS = {1: 13, 2: 14, 3: 15, 4: 15}  # number of file rights by Landlock's version
_MOST_RIGHTS = 16
_FILE_RIGHTS = 0b1100000000000111  # the rights that apply to a file; the others apply to folders
_NO_TCP, _SCOPES = 0b11, 0b11

_EXECUTE, _WRITE_FILE, _READ_FILE, _READ_FOLDER, _REMOVE_FOLDER, _REMOVE_FILE = (1 << bit for bit in range(6))
_MAKE_FOLDER, _MAKE_FILE, _MOVE, _TRUNCATE = 1 << 7, 1 << 8, 1 << 13, 1 << 14
READ = _READ_FILE | _READ_FOLDER
RUN = READ | _EXECUTE
ALL = (1 << 16) - 1
# No devices, sockets, pipes or symbolic links.
WRITE = READ | _WRITE_FILE | _REMOVE_FOLDER | _REMOVE_FILE | _MAKE_FOLDER | _MAKE_FILE | _MOVE | _TRUNCATE
_O_PATH = 0o10000000

_SET_DEATH_SIGNAL, _SET_SECCOMP, _SET_NO_NEW_PRIVS = 1, 22, 38
_FILTER = 2
_NEW_USER, _NEW_NET = 0x10000000, 0x40000000
_CAPABILITY_VERSION = 0x20080522
_CAP_DAC_READ_SEARCH = 1 << 2

_ARCHITECTURES = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7}
_X32 = 0x40000000  # from here on: calls of x86's 32-bit interface
_CLONE_THREAD = 0x00010000
_LOAD, _EQUAL, _AT_LEAST, _HAS_BITS, _RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
_NUMBER, _ARCHITECTURE, _FIRST_ARGUMENT = 0, 4, 16  # offsets in struct seccomp_data
_ALLOW, _ERRNO = 0x7FFF0000, 0x00050000

_libc = ctypes.CDLL(None, use_errno=True) if sys.platform == "linux" else None


def die_with_parent(parent: int) -> None:
    """Makes the kernel kill this process when its parent ends. Linux only."""
    if _libc is not None:
        _libc.prctl(_SET_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0)
        if os.getppid() != parent:  # the parent ended before the call
            os._exit(1)


def forbid_new_privileges() -> None:
    """Sets no_new_privs: programs started by this process cannot gain privileges."""
    if _libc is not None:
        _libc.prctl(_SET_NO_NEW_PRIVS, 1, 0, 0, 0)


def enter_empty_network() -> bool:
    """Moves this process into an empty network namespace; returns False if the operating system does not permit that."""
    return _libc is not None and (_libc.unshare(_NEW_USER | _NEW_NET) == 0 or _libc.unshare(_NEW_NET) == 0)


def available_features() -> tuple[list[str], list[str]]:
    """Returns the names of the available and of the missing features (Landlock, seccomp) of the operating system's kernel.

    Changes nothing.
    """
    version = _libc.syscall(_CREATE, None, 0, _VERSION) if _libc is not None else 0
    # For a filter at address 0, a kernel with filters returns EFAULT, others EINVAL.
    has_filters = (
        _libc is not None
        and platform.machine() in DENIED
        and _libc.prctl(_SET_SECCOMP, _FILTER, None, 0, 0) != 0
        and ctypes.get_errno() == errno.EFAULT
    )
    found = {f"Landlock {version}" if version > 0 else "Landlock": version > 0, "seccomp": has_filters}
    return [name for name, has in found.items() if has], [name for name, has in found.items() if not has]


def restrict_files(grants: Iterable[tuple[str, int]]) -> bool:
    """Restricts this process to these paths, each with READ, RUN or WRITE; returns True if Landlock is available.

    Non-existent paths are skipped. From Landlock version 4 on, TCP is refused too; from 6 on, signals to other processes and
    abstract sockets.
    """
    if _libc is None:
        return False
    version = _libc.syscall(_CREATE, None, 0, _VERSION)
    if version < 1:
        return False
    rights = (1 << _RIGHTS.get(version, _MOST_RIGHTS)) - 1
    attributes = struct.pack("<Q", rights)
    if version >= 4:
        attributes += struct.pack("<Q", _NO_TCP)
    if version >= 6:
        attributes += struct.pack("<Q", _SCOPES)
    rules = _libc.syscall(_CREATE, attributes, len(attributes), 0)
    if rules < 0:
        return False
    for path, granted in grants:
        try:
            opened = os.open(path, _O_PATH | os.O_CLOEXEC)
        except OSError:
            continue
        allowed = granted & rights & (~0 if Path(path).is_dir() else _FILE_RIGHTS)
        _libc.syscall(_ADD_RULE, rules, _PATH_BENEATH, struct.pack("<Qi", allowed, opened), 0)
        os.close(opened)
    forbid_new_privileges()
    restricted = _libc.syscall(_RESTRICT, rules, 0) == 0
    os.close(rules)
    return bool(restricted)


def drop_capabilities(keep_reading: bool) -> None:
    """Drops this process's capabilities. keep_reading: keeps the capability to read files of other users."""
    if _libc is None:
        return
    header = struct.pack("<Ii", _CAPABILITY_VERSION, 0)
    held = ctypes.create_string_buffer(24)
    if _libc.capget(header, held) != 0:
        return
    _, permitted = struct.unpack("<II", held.raw[:8])
    kept = permitted & _CAP_DAC_READ_SEARCH if keep_reading else 0
    _libc.capset(header, struct.pack("<IIIIII", kept, kept, 0, 0, 0, 0))


def filter_calls() -> bool:
    """Installs the seccomp filter, which refuses network, exec, fork and other calls not needed to read files.

    Returns True if the filter was installed. Refused calls fail with EPERM. Threads may be started, processes may not.
    """
    machine = platform.machine()
    if _libc is None or machine not in DENIED or sys.maxsize < 2**32:
        return False
    program = b"".join(_program(machine))

    class Program(ctypes.Structure):
        _fields_ = (("length", ctypes.c_ushort), ("filter", ctypes.c_char_p))

    forbid_new_privileges()
    given = Program(len(program) // 8, program)
    return bool(_libc.prctl(_SET_SECCOMP, _FILTER, ctypes.byref(given), 0, 0) == 0)


def _program(machine: str) -> Iterable[bytes]:
    """Yields the seccomp filter as classic BPF, eight bytes per instruction."""

    def instruction(code: int, value: int, if_true: int = 0, if_false: int = 0) -> bytes:
        return struct.pack("<HBBI", code, if_true, if_false, value)

    refuse = instruction(_RETURN, _ERRNO | errno.EPERM)
    yield instruction(_LOAD, _ARCHITECTURE)
    yield instruction(_EQUAL, _ARCHITECTURES[machine], 1, 0)
    yield refuse
    yield instruction(_LOAD, _NUMBER)
    if machine == "x86_64":
        yield instruction(_AT_LEAST, _X32, 0, 1)
        yield refuse
    for number in DENIED[machine]:
        yield instruction(_EQUAL, number, 0, 1)
        yield refuse
    yield instruction(_EQUAL, CLONE_3, 0, 1)
    yield instruction(_RETURN, _ERRNO | errno.ENOSYS)
    yield instruction(_EQUAL, THREADS[machine], 0, 4)
    yield instruction(_LOAD, _FIRST_ARGUMENT)
    yield instruction(_HAS_BITS, _CLONE_THREAD, 0, 1)
    yield instruction(_RETURN, _ALLOW)
    yield refuse
    for number, itself in TO_ITSELF[machine].items():
        yield instruction(_EQUAL, number, 0, 5)
        yield instruction(_LOAD, _FIRST_ARGUMENT)
        yield instruction(_EQUAL, os.getpid(), 1, 0)
        yield instruction(_EQUAL, os.getpid() if itself is None else itself, 0, 1)
        yield instruction(_RETURN, _ALLOW)
        yield refuse
    yield instruction(_RETURN, _ALLOW)
