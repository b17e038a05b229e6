"""Copies precompiled kernels from a container image or a wheel into the kernel cache, before anything is compiled.

Only kernels that the cache lacks are copied. The cache may therefore be on a volume that outlives the container image, and all
other folders may be read-only.
"""

from __future__ import annotations

import logging
import os
from pathlib import Path

from renderer.cache_folders import make_private, read_private
from renderer.sources import ROOT

__all__ = ["FOLDER", "copy_finished_kernels", "copy_shipped_kernels"]

FOLDER = "RAYFARM_KERNELS"  # a folder with a subfolder per state of the sources, as in the cache
IN_WHEEL = ROOT / "kernels"  # such a folder, if hatch_build.py added one to the wheel
LISTS = "*.done"

log = logging.getLogger(__name__)


def copy_shipped_kernels(cache: Path) -> None:
    """Copies the installation's kernels to this cache folder. If that fails, logs a warning; the kernels are then compiled.

    The kernels are copied from $RAYFARM_KERNELS, else from the wheel from which Rayfarm was installed.
    """
    shipped = Path(os.environ.get(FOLDER, "") or IN_WHEEL)
    try:
        copy_finished_kernels(shipped / cache.name, cache)
    except OSError as error:
        log.warning("the kernels in %s cannot be copied to %s and are compiled: %s", shipped, cache, error)


def copy_finished_kernels(source: Path, to: Path) -> int:
    """Copies the files of all complete kernels in the folder `source`, and their lists; returns the number of copied files.

    Existing files are not replaced: equal names imply equal content. The lists are copied last, so that every listed file exists.
    Files writable by other users are not copied (renderer/cache_folders.py). Raises OSError if copying fails.
    """
    lists = sorted(source.glob(LISTS))
    names = sorted({name for each in lists for name in each.read_text().split()})
    missing = [name for name in (*names, *(each.name for each in lists)) if not (to / name).exists()]
    for name in missing:
        if (content := read_private(source / name)) is not None:
            _write(to / name, content)
    return len(missing)


def _write(path: Path, content: bytes) -> None:
    """Writes a file atomically, readable by its owner only."""
    make_private(path.parent)
    beside = path.with_name(f".part-{os.getpid()}-{path.name}")
    try:
        beside.touch(0o600)
        beside.write_bytes(content)
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)
