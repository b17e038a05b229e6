"""Blender's add-on as an installable archive of the sources in `blender`, with this release's version inserted."""

from __future__ import annotations

import io
import re
import zipfile
from pathlib import Path

from renderer import __version__
from service.locations import shipped_folder

__all__ = ["FILE", "addon_zip"]

FILE = "rayfarm-blender.zip"
FOLDER = "rayfarm_addon"
ENTRY_TIME = (1980, 1, 1, 0, 0, 0)  # fixed time, so that equal sources give equal bytes
MANIFEST_VERSION = '\nversion = "0.0.0"\n'
BL_INFO_VERSION = '"version": (0, 0, 0)'


def addon_zip(version: str = __version__) -> bytes:
    """Returns the add-on's zip archive. Blender 4.2 and later install it as an extension, older ones as a legacy add-on."""
    folder = shipped_folder("blender") / FOLDER
    found = io.BytesIO()
    with zipfile.ZipFile(found, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(folder.rglob("*")):
            name = path.relative_to(folder)
            if path.suffix not in (".py", ".toml") or "__pycache__" in name.parts:
                continue
            info = zipfile.ZipInfo(f"{FOLDER}/{name.as_posix()}", ENTRY_TIME)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            archive.writestr(info, _insert_version(path, version))
    return found.getvalue()


def _insert_version(path: Path, version: str) -> str:
    text = path.read_text(encoding="utf-8")
    numbers = [*re.findall(r"\d+", version), "0", "0", "0"][:3]
    text = text.replace(MANIFEST_VERSION, f'\nversion = "{".".join(numbers)}"\n')
    return text.replace(BL_INFO_VERSION, f'"version": ({", ".join(numbers)})')
