"""The files that a USD scene consists of: those of its folder, and those inside of its .usdz packages.

A file in a package is called `package.usdz[folder/inner.usda]`, as USD calls it.
"""

from __future__ import annotations

import io
import posixpath
import zipfile
from pathlib import PurePosixPath

from renderer.errors import SceneError
from renderer.scene.files import MAX_FILE_BYTES, SceneFiles
from renderer.scene.udim import tiles_of
from renderer.zips import DAMAGED

__all__ = ["LAYER_SUFFIXES", "Sources"]

LAYER_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
_PACKAGE = ".usdz"


class Sources:
    """Finds and reads the files; nothing outside of the scene's folder is opened, whatever a layer asks for."""

    def __init__(self, files: SceneFiles) -> None:
        self._files = files
        self._packages: dict[str, zipfile.ZipFile] = {}
        self._names: dict[str, tuple[set[str], dict[str, str]]] = {}  # what is in each, and the first of each bare name

    def find(self, reference: str, beside: str) -> str | None:
        """The name of the file that a layer means by an asset path; None where it is not among the scene's."""
        wanted = reference.split(":SDF_FORMAT_ARGS:")[0].replace("\\", "/")
        package, inner = split(beside)
        if inner is not None and (found := self._in_package(package, wanted, inner)):
            return found
        outer, inside = split(wanted)
        found = self._files.find(outer, package)
        if found is None or inside is None:
            return found
        return self._in_package(found, inside, "")

    def is_outside(self, reference: str, beside: str) -> bool:
        """Whether an asset path, relative to a layer, leads out of the scene's folder."""
        return self._files.is_outside(split(reference)[0], split(beside)[0])

    def path(self, name: str) -> str:
        """Where USD opens a layer. Raises SceneError where it is not to be opened."""
        outer, inner = split(name)
        path = str(self._files.path(outer))
        return path if inner is None else f"{path}[{inner}]"

    def read(self, name: str) -> bytes:
        """The bytes of a file. Raises SceneError."""
        outer, inner = split(name)
        if inner is None:
            return self._files.read(outer)
        package = self._package(outer)
        entry = package.getinfo(inner)
        # Packages are not compressed, so that nothing in them is larger than they are.
        if entry.compress_type != zipfile.ZIP_STORED or entry.file_size > min(MAX_FILE_BYTES, self._size(outer)):
            raise SceneError(f"{name}: is compressed, which USD does not know; package it again by usdzip")
        try:
            return package.read(entry)
        except (*DAMAGED, OSError) as error:
            raise SceneError(f"{name}: could not be read ({error}); package it again") from error

    def root_of(self, name: str) -> str:
        """A layer's own name; of a package, that of its first file, which is its root layer. Raises SceneError."""
        outer, inner = split(name)
        if inner is not None or not outer.lower().endswith(_PACKAGE):
            return name
        first = next((entry for entry in self._package(outer).namelist() if not entry.endswith("/")), None)
        if first is None or PurePosixPath(first).suffix.lower() not in LAYER_SUFFIXES[:3]:
            raise SceneError(f"{outer}: does not begin with a USD layer, as a package must; package it again by usdzip")
        return f"{outer}[{first}]"

    def tiles(self, reference: str, beside: str) -> dict[int, str]:
        """The files of a texture in UDIM tiles, by their numbers from 1001 to 1100."""
        package, inner = split(beside)

        def find(name: str) -> str | None:
            at = self._in_package(package, name, inner) if inner is not None else None
            return at or self._files.find(name, package)

        return tiles_of(reference, find)

    def _in_package(self, package: str, wanted: str, beside: str) -> str | None:
        if package not in self._names:
            listed = sorted(self._package(package).namelist())
            self._names[package] = set(listed), {posixpath.basename(name): name for name in reversed(listed)}
        names, by_bare_name = self._names[package]
        near = posixpath.normpath(posixpath.join(posixpath.dirname(beside), wanted))
        for name in (near, posixpath.normpath(wanted).lstrip("/")):
            if name in names:
                return f"{package}[{name}]"
        bare = by_bare_name.get(posixpath.basename(wanted)) if posixpath.basename(wanted) else None
        return f"{package}[{bare}]" if bare is not None else None

    def _size(self, outer: str) -> int:
        return self._files.path(outer).stat().st_size

    def _package(self, outer: str) -> zipfile.ZipFile:
        if outer not in self._packages:
            try:
                self._packages[outer] = zipfile.ZipFile(io.BytesIO(self._files.read(outer)))
            except DAMAGED as error:
                raise SceneError(f"{outer}: is no whole .usdz package ({error}); package it again") from error
        return self._packages[outer]


def split(name: str) -> tuple[str, str | None]:
    """(package, file in it) of the name of a file in a package; (name, None) of any other."""
    at = name.find(f"{_PACKAGE}[")
    if at < 0 or not name.endswith("]"):
        return name, None
    return name[: at + len(_PACKAGE)], name[at + len(_PACKAGE) + 1 : -1]
