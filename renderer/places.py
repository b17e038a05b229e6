"""Where this machine keeps what can be made again: kernels, what sources mean, fetched scenes, a worker's log."""

from __future__ import annotations

import os
from pathlib import Path

import platformdirs

__all__ = ["cache_home"]


def cache_home() -> Path:
    """$RAYFARM_CACHE, by default the user's cache folder: on Linux ~/.cache/rayfarm."""
    named = os.environ.get("RAYFARM_CACHE")
    return Path(named).expanduser() if named else platformdirs.user_cache_path("rayfarm", appauthor=False)
