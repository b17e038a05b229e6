"""Functions that tests run in confined (sandboxed) reader processes."""

from __future__ import annotations

import ctypes
import os
import resource
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from renderer.confine.reader import Link
from renderer.errors import SceneError


def _refused(action: Callable[[], Any]) -> bool:
    try:
        action()
    except PermissionError:
        return True
    return False


def probe(link: Link) -> dict[str, Any]:
    """Returns the reader's environment, open files and restrictions, and which of several forbidden operations are refused."""
    link.send({"step": "probing"})
    descriptors = [str(path.readlink()) for path in Path("/proc/self/fd").iterdir() if path.is_symlink()]
    status = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    Path("own").write_text("written")
    return {
        "environment": dict(os.environ),
        "descriptors": descriptors,
        "status": {name: status[name].strip() for name in ("NoNewPrivs", "Seccomp")},
        "refused": {
            "socket": _refused(socket.socket),
            "program": _refused(lambda: subprocess.run(["true"], check=False)),
            "process": _refused(os.fork),
            "read": _refused(lambda: Path("/etc/passwd").read_text()),
            "write": _refused(lambda: Path("/tmp/rayfarm-never").write_text("")),
            "signal": _refused(lambda: os.kill(os.getppid(), 0)),
            "mode": _refused(lambda: Path("own").chmod(0o777)),
            "link": _refused(lambda: Path("out").symlink_to("/etc/passwd")),
        },
    }


def size(link: Link) -> dict[str, Any]:
    """Returns the reader's address space in bytes."""
    return {"size": int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()}


def crash(link: Link) -> dict[str, Any]:
    """Reads address 0, which causes SIGSEGV."""
    return {"read": ctypes.string_at(0)}


def abort(link: Link) -> dict[str, Any]:
    """Ends the process by SIGABRT."""
    os.abort()


def hungry(link: Link) -> dict[str, Any]:
    """Allocates 4 GiB."""
    return {"size": len(bytearray(4 << 30))}


def slow(link: Link) -> dict[str, Any]:
    """Sleeps for a minute."""
    time.sleep(60)
    return {}


def wrong(link: Link) -> dict[str, Any]:
    """Raises a SceneError."""
    raise SceneError("truck.glb: the buffer ends early; export it again")
