"""Locations of the web page, the examples, Blender's add-on, and the data.

In a clone these are folders at its top, including the data, so removing the clone removes everything. In an installed Rayfarm
the page, examples and add-on are in this package, and the data is in the user's data folder.
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
    """Returns the path of a folder shipped with Rayfarm: `web`, `scenes` or `blender`."""
    return CLONE / name if CLONE else _PACKAGE / ("examples" if name == "scenes" else name)


def default_data_folder() -> Path:
    """Returns $RAYFARM_DATA if set; else `data` in the clone; else the user's data folder, on Linux ~/.local/share/rayfarm."""
    named = os.environ.get("RAYFARM_DATA")
    if named:
        return Path(named).expanduser().resolve()
    return CLONE / "data" if CLONE else platformdirs.user_data_path("rayfarm", appauthor=False)


def sqlite_url(path: Path) -> str:
    """Returns the URL of an SQLite database file, with characters such as % and ? escaped by SQLAlchemy."""
    from sqlalchemy import URL

    return URL.create("sqlite", database=str(path)).render_as_string(hide_password=False)
