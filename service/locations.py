"""Locations of the web page, the examples, Blender's add-on, and the data.

In a clone these are folders at the clone's root, so removing the clone removes everything. In an installed Rayfarm the page,
examples and add-on are in this package, and the data is in the user's data folder.
"""

from __future__ import annotations

import os
from pathlib import Path

import platformdirs

__all__ = ["SOURCE_CHECKOUT", "data_folder_without_variable", "default_data_folder", "shipped_folder", "sqlite_url"]

_PACKAGE = Path(__file__).resolve().parent
_PACKAGE_PARENT = _PACKAGE.parent

_INSTALLED_AS = {"scenes": "examples", "docs": "guide_pages"}

SOURCE_CHECKOUT = _PACKAGE_PARENT if (_PACKAGE_PARENT / "farm.py").is_file() and (_PACKAGE_PARENT / "web").is_dir() else None


def shipped_folder(name: str) -> Path:
    """Returns the path of a folder shipped with Rayfarm: `web`, `scenes`, `blender` or `docs`."""
    return SOURCE_CHECKOUT / name if SOURCE_CHECKOUT else _PACKAGE / _INSTALLED_AS.get(name, name)


def default_data_folder() -> Path:
    """Returns $RAYFARM_DATA if set; else `data` in the clone; else the user's data folder, on Linux ~/.local/share/rayfarm."""
    named = os.environ.get("RAYFARM_DATA")
    if named:
        return Path(named).expanduser().resolve()
    return data_folder_without_variable()


def data_folder_without_variable() -> Path:
    """Returns the data folder that is used if $RAYFARM_DATA is not set."""
    return SOURCE_CHECKOUT / "data" if SOURCE_CHECKOUT else platformdirs.user_data_path("rayfarm", appauthor=False)


def sqlite_url(path: Path) -> str:
    """Returns the URL of an SQLite database file, with characters such as % and ? escaped by SQLAlchemy."""
    from sqlalchemy import URL

    return URL.create("sqlite", database=str(path)).render_as_string(hide_password=False)
