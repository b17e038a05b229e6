"""Becomes another program that may open, take and reach little: a script, run by a Python without threads.

    python confined.py LIMITS PROGRAM ARGUMENT ...

LIMITS: JSON with `reads` and `writes`, paths of files and folders; `memory` (bytes) and `seconds` of processor time.

On Linux that is the kernel's Landlock (5.13 and later: files; 6.7: no TCP), and a network namespace with nothing in it where
one can be had. Elsewhere memory and time alone are bounded.
"""

from __future__ import annotations

import ctypes
import json
import os
import resource
import signal
import struct
import sys
from pathlib import Path

CREATE, ADD_RULE, RESTRICT = 444, 445, 446  # Landlock's system calls, on all processors alike
VERSION, PATH_BENEATH = 1, 1
READ = 0b1101  # execute, read a file, list a folder
OF_FILES = 0b1100000000000111  # the rights that a file has; others are of folders
RIGHTS = {1: 13, 2: 14, 3: 15, 4: 15}  # how many rights there are, by the kernel's version of it
MOST_RIGHTS = 16
NO_TCP, SCOPES = 0b11, 0b11
O_PATH = 0o10000000
SET_NO_NEW_PRIVS, SET_DEATH_SIGNAL = 38, 1
NEW_USER, NEW_NET = 0x10000000, 0x40000000
LARGEST_FILE = 16 << 30


def limit(memory: int, seconds: int) -> None:
    """Bounds what this process and its children may take."""
    _, most = resource.getrlimit(resource.RLIMIT_AS)
    memory = memory if most == resource.RLIM_INFINITY else min(memory, most)
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    _, most = resource.getrlimit(resource.RLIMIT_CPU)
    seconds = seconds if most == resource.RLIM_INFINITY else min(seconds, most)
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (LARGEST_FILE, LARGEST_FILE))


def leave_network(libc: ctypes.CDLL) -> None:
    """Where the kernel lets this user: a network with nothing in it."""
    if libc.unshare(NEW_USER | NEW_NET) != 0:
        libc.unshare(NEW_NET)


def leave_files(libc: ctypes.CDLL, reads: list[str], writes: list[str]) -> bool:
    """From now on only these are there; False where the kernel cannot do that."""
    version = libc.syscall(CREATE, None, 0, VERSION)
    if version < 1:
        return False
    rights = (1 << RIGHTS.get(version, MOST_RIGHTS)) - 1
    attributes = struct.pack("<Q", rights)
    if version >= 4:
        attributes += struct.pack("<Q", NO_TCP)
    if version >= 6:
        attributes += struct.pack("<Q", SCOPES)  # no abstract sockets of others, no signals to them
    rules = libc.syscall(CREATE, attributes, len(attributes), 0)
    if rules < 0:
        return False
    for paths, granted in ((reads, READ), (writes, rights)):
        for path in paths:
            try:
                opened = os.open(path, O_PATH | os.O_CLOEXEC)
            except OSError:
                continue
            allowed = granted if Path(path).is_dir() else granted & OF_FILES & rights
            libc.syscall(ADD_RULE, rules, PATH_BENEATH, struct.pack("<Qi", allowed, opened), 0)
            os.close(opened)
    libc.prctl(SET_NO_NEW_PRIVS, 1, 0, 0, 0)
    return bool(libc.syscall(RESTRICT, rules, 0) == 0)


def main() -> None:
    """The command."""
    limits, command = json.loads(sys.argv[1]), sys.argv[2:]
    if sys.platform == "linux":
        libc = ctypes.CDLL(None, use_errno=True)
        libc.prctl(SET_DEATH_SIGNAL, signal.SIGKILL, 0, 0, 0)
        leave_network(libc)
        if not leave_files(libc, limits["reads"], limits["writes"]):
            print("this kernel has no Landlock: files are guarded by their names alone", file=sys.stderr)
    limit(int(limits["memory"]), int(limits["seconds"]))
    os.execv(command[0], command)


if __name__ == "__main__":
    main()
