"""Checks whether another process on this machine has ended or is suspended, and kills it.

Linux only. On other systems, and for processes of other machines or containers, the state is unknown, and the functions return
None or False.
"""

from __future__ import annotations

import os
import signal
from contextlib import suppress
from pathlib import Path
from typing import Any

__all__ = ["is_gone", "is_stopped", "kill_process", "this_process"]

PROC = Path("/proc")
STATE, STARTED = 0, 19  # indexes of fields in /proc/PID/stat after the command's name


def this_process() -> dict[str, Any] | None:
    """Returns an identification of this process that is never reused: boot, PID namespace, PID, start time.

    None if unavailable.
    """
    try:
        return {**_boot_and_namespace(), "pid": os.getpid(), "started": _stat(os.getpid())[STARTED]}
    except (OSError, IndexError):
        return None


def is_gone(identity: dict[str, Any] | None) -> bool:
    """Returns True if a process has ended; False if unknown. identity: result of `this_process` in that process."""
    return identity is not None and _is_on_this_machine(identity) and _state_letter(identity) in (None, "Z", "X")


def is_stopped(identity: dict[str, Any] | None) -> bool:
    """Returns True if a process is suspended (by SIGSTOP or a debugger). identity: result of `this_process` in that process."""
    return identity is not None and _is_on_this_machine(identity) and _state_letter(identity) in ("T", "t")


def kill_process(identity: dict[str, Any]) -> bool:
    """Kills a process, even a suspended one. Returns whether it was killed.

    identity: result of `this_process` in that process.
    """
    try:
        handle = os.pidfd_open(identity["pid"])
    except (OSError, AttributeError, KeyError, TypeError):
        return False
    try:
        # Checked while the handle is open, since the PID may have been reused before.
        if not _is_on_this_machine(identity) or _state_letter(identity) is None:
            return False
        signal.pidfd_send_signal(handle, signal.SIGKILL)
    except OSError:
        return False
    finally:
        os.close(handle)
    return True


def _boot_and_namespace() -> dict[str, str]:
    """Returns the ids of the current boot and of this process's PID namespace, which differs between containers."""
    boot = (PROC / "sys" / "kernel" / "random" / "boot_id").read_text().strip()
    return {"boot": boot, "numbers": os.readlink(PROC / "self" / "ns" / "pid")}  # noqa: PTH115 - not a path


def _is_on_this_machine(identity: dict[str, Any]) -> bool:
    with suppress(OSError):
        return all(identity.get(name) == value for name, value in _boot_and_namespace().items())
    return False


def _state_letter(identity: dict[str, Any]) -> str | None:
    """Returns a process's state letter from /proc; None if the process has ended, "?" if the state cannot be read."""
    try:
        found = _stat(int(identity["pid"]))
        return found[STATE] if found[STARTED] == identity["started"] else None
    except FileNotFoundError:
        return None
    except (OSError, IndexError, KeyError, ValueError, TypeError):
        return "?"


def _stat(pid: int) -> list[str]:
    return (PROC / str(pid) / "stat").read_text().rpartition(")")[2].split()
