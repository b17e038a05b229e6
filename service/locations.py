"""Locations of the page, the examples, Blender's add-on, and the data.

In a clone, the page, the examples and the add-on are folders at its top, and the data is in the clone as well, so that removing
the clone removes everything. In an installed Rayfarm they are inside this package, and the data is in the user's data folder.
"""

from __future__ import annotations

import os
from pathlib import Path

import platformdirs

__all__ = ["CLONE", "default_data_folder", "shipped", "sqlite_url"]

_PACKAGE = Path(__file__).resolve().parent
_ABOVE = _PACKAGE.parent

CLONE = _ABOVE if (_ABOVE / "farm.py").is_file() and (_ABOVE / "web").is_dir() else None


def shipped(name: str) -> Path:
    """Returns a folder that is shipped with Rayfarm: `web`, `scenes` or `blender`."""
    return CLONE / name if CLONE else _PACKAGE / ("examples" if name == "scenes" else name)


def default_data_folder() -> Path:
    """Returns $RAYFARM_DATA; else `data` in the clone; else the user's data folder, on Linux ~/.local/share/rayfarm."""
    named = os.environ.get("RAYFARM_DATA")
    if named:
        return Path(named).expanduser().resolve()
    return CLONE / "data" if CLONE else platformdirs.user_data_path("rayfarm", appauthor=False)


def sqlite_url(path: Path) -> str:
    """Returns the URL of an SQLite database file; SQLAlchemy escapes characters such as % and ? in the path."""
    from sqlalchemy import URL

    return URL.create("sqlite", database=str(path)).render_as_string(hide_password=False)
