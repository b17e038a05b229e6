"""Blender's add-on as the archive that Blender installs: the sources in `blender`, with this release's version filled in."""

from __future__ import annotations

import io
import re
import zipfile
from pathlib import Path

from renderer import __version__
from service.places import shipped

__all__ = ["FILE", "addon_zip"]

FILE = "rayfarm-blender.zip"
FOLDER = "rayfarm_addon"
LONG_AGO = (1980, 1, 1, 0, 0, 0)  # so that equal sources are equal bytes
MANIFEST_VERSION = '\nversion = "0.0.0"\n'
BL_INFO_VERSION = '"version": (0, 0, 0)'


def addon_zip(version: str = __version__) -> bytes:
    """The archive. Blender 4.2 and later take it as an extension, by the manifest at its top, or as an add-on of old."""
    folder = shipped("blender") / FOLDER
    found = io.BytesIO()
    with zipfile.ZipFile(found, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(folder.rglob("*")):
            name = path.relative_to(folder)
            if path.suffix not in (".py", ".toml") or "__pycache__" in name.parts:
                continue
            info = zipfile.ZipInfo(f"{FOLDER}/{name.as_posix()}", LONG_AGO)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            archive.writestr(info, _versioned(path, version))
    return found.getvalue()


def _versioned(path: Path, version: str) -> str:
    text = path.read_text(encoding="utf-8")
    numbers = [*re.findall(r"\d+", version), "0", "0", "0"][:3]
    text = text.replace(MANIFEST_VERSION, f'\nversion = "{".".join(numbers)}"\n')
    return text.replace(BL_INFO_VERSION, f'"version": ({", ".join(numbers)})')
