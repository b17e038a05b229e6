"""Limits the memory, processor time and file size of a reader, never above the caller's own limits."""

from __future__ import annotations

import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from renderer.sentences import Sentence

__all__ = [
    "available_memory",
    "callers_limit_phrase",
    "importer_memory",
    "inherited_limit",
    "limit_program",
    "limited_memory",
    "set_limits",
    "size_text",
]

LARGEST_FILE = 16 << 30
_CGROUPS = Path("/sys/fs/cgroup")
_UNKNOWN = 8 << 30  # bytes assumed to be available if the system does not report it
_IMPORTER, _IMPORTER_PER_BYTE = 512 << 20, 200  # whole files take up to 30 times their size
_GRACE_S = 5  # between SIGXCPU and SIGKILL

# Limits by their names in a shell; each as (resource, unit in bytes or seconds, what it limits).
_NAMED = {
    "-v": (resource.RLIMIT_AS, Sentence("limit-address-space", "address space")),
    "-t": (resource.RLIMIT_CPU, Sentence("limit-processor-time", "processor time")),
    "-f": (resource.RLIMIT_FSIZE, Sentence("limit-file-size", "file size")),
}


def available_memory() -> int:
    """Returns the number of bytes that can be allocated now, as limited by the machine and by every cgroup of this process."""
    return max(min([_free_machine_memory(), *_free_cgroup_memory()]), 0)


def _free_machine_memory() -> int:
    try:
        for line in Path("/proc/meminfo").read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return int(line.split()[1]) * 1024
    except (OSError, ValueError):
        pass
    return _UNKNOWN


def _free_cgroup_memory() -> Iterator[int]:
    """Yields how many bytes are free in each memory-limited cgroup, from this process's cgroup up to the root; cgroup versions 1
    and 2.
    """
    try:
        lines = Path("/proc/self/cgroup").read_text().splitlines()
    except OSError:
        return
    for line in lines:
        _, controllers, path = line.split(":", 2)
        if controllers == "":
            names, roots = ("memory.max", "memory.current", "inactive_file"), [_CGROUPS, _CGROUPS / "unified"]
        elif "memory" in controllers.split(","):
            names = ("memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file")
            roots = [_CGROUPS / "memory"]
        else:
            continue
        for root in roots:
            inside = root / path.strip("/")
            for folder in (inside, *inside.parents):  # a container sees its own cgroup as the root
                if not folder.is_relative_to(root):
                    break
                if (left := _cgroup_memory_left(folder, *names)) is not None:
                    yield left


def _cgroup_memory_left(folder: Path, limit_name: str, used_name: str, cache_name: str) -> int | None:
    try:
        limit, used = (int((folder / name).read_text()) for name in (limit_name, used_name))
        stat = dict(line.split(" ", 1) for line in (folder / "memory.stat").read_text().splitlines())
        return limit - used + int(stat.get(cache_name, 0))
    except (OSError, ValueError):  # no such file, or "max"
        return None


def importer_memory(size: int) -> int:
    """Returns the memory limit, in bytes, of the reader process that imports a scene file of `size` bytes.

    A limit is needed because damaged files may state counts of gigabytes.
    """
    return _IMPORTER + _IMPORTER_PER_BYTE * size


def set_limits(memory: int, seconds: float) -> int:
    """Limits this process: `memory` bytes beyond its current use, processor time for `seconds` on all cores, no core dumps.

    Existing lower limits are kept. Returns how many bytes of address space the process can still allocate.
    """
    used = _address_space()
    limit_program(used + memory, int(seconds * (os.cpu_count() or 1)) + 1)
    return max(resource.getrlimit(resource.RLIMIT_AS)[0] - used, 0)


def limit_program(memory: int, seconds: int) -> None:
    """Limits this process to `memory` bytes of address space and `seconds` of processor time; the limits survive exec."""
    _lower_limit(resource.RLIMIT_AS, memory)
    _lower_limit(resource.RLIMIT_CPU, seconds, _GRACE_S)
    _lower_limit(resource.RLIMIT_FSIZE, LARGEST_FILE)
    _lower_limit(resource.RLIMIT_CORE, 0)


def _lower_limit(which: int, value: int, grace: int = 0) -> None:
    soft, hard = resource.getrlimit(which)
    finite = [limit for limit in (soft, hard) if limit != resource.RLIM_INFINITY]
    soft = min([value, *finite])
    hard = soft + grace if hard == resource.RLIM_INFINITY else min(soft + grace, hard)
    resource.setrlimit(which, (soft, hard))


def _address_space() -> int:
    """Returns the size of this process's address space in bytes."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    except OSError:
        return 4 << 30


@contextmanager
def limited_memory(memory: int) -> Iterator[bool]:
    """Context manager that limits this process to `memory` bytes of address space beyond its current use.

    Yields True if the process already had a lower limit, which then stays in force.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    finite = [limit for limit in (soft, hard) if limit != resource.RLIM_INFINITY]
    wanted = _address_space() + memory
    resource.setrlimit(resource.RLIMIT_AS, (min([wanted, *finite]), hard))
    try:
        yield any(limit < wanted for limit in finite)
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def inherited_limit(option: str) -> int | None:
    """Returns the soft resource limit with which this process was started, in bytes or seconds; None if there is none.

    option: the option of `ulimit` for that limit, such as "-v".
    """
    soft, _ = resource.getrlimit(_NAMED[option][0])
    return None if soft == resource.RLIM_INFINITY else soft


def callers_limit_phrase(option: str) -> str | None:
    """Returns a phrase for messages that names a resource limit with which this process was started; None if there is none.

    For example "its limit on address space (ulimit -v) of 2.0 GiB". option: as for `inherited_limit`.
    """
    value = inherited_limit(option)
    if value is None:
        return None
    size = f"{value} s" if option == "-t" else size_text(value)
    return Sentence(
        "machine-limit",
        "its limit on {resource} (ulimit {option}) of {size}",
        resource=_NAMED[option][1],
        option=option,
        size=size,
    )


def size_text(value: int) -> str:
    """Returns a number of bytes as text: "1.5 GiB"."""
    return f"{value / 2**30:.1f} GiB" if value >= 2**29 else f"{value / 2**20:.1f} MiB"
