"""Finds and reads the files of a USD scene, in its folder and inside its .usdz packages.

A file in a package is named `package.usdz[folder/inner.usda]`, as in USD.
"""

from __future__ import annotations

import io
import posixpath
import zipfile
from pathlib import PurePosixPath

from renderer.errors import SceneError
from renderer.library_messages import library_message
from renderer.scene.files import MAX_FILE_BYTES, SceneFiles
from renderer.scene.udim import tiles_of
from renderer.sentences import Sentence
from renderer.zips import DAMAGED

__all__ = ["LAYER_SUFFIXES", "Sources"]

LAYER_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
_PACKAGE = ".usdz"


class Sources:
    """Finds and reads the scene's files; never opens a file outside the scene's folder."""

    def __init__(self, files: SceneFiles) -> None:
        self._files = files
        self._packages: dict[str, zipfile.ZipFile] = {}
        self._names: dict[str, tuple[set[str], dict[str, str]]] = {}  # per package: files, first file by bare name

    def find(self, reference: str, beside: str) -> str | None:
        """Returns the name of the file that an asset path in a layer refers to; None if it is not among the scene's files.

        beside: name of the layer's file.
        """
        wanted = reference.split(":SDF_FORMAT_ARGS:")[0].replace("\\", "/")
        package, inner = split_package_path(beside)
        if inner is not None and (found := self._in_package(package, wanted, inner)):
            return found
        outer, inside = split_package_path(wanted)
        found = self._files.find(outer, package)
        if found is None or inside is None:
            return found
        return self._in_package(found, inside, "")

    def is_outside(self, reference: str, beside: str) -> bool:
        """Returns True if an asset path, relative to the layer `beside`, leads outside the scene's folder."""
        return self._files.is_outside(split_package_path(reference)[0], split_package_path(beside)[0])

    def path(self, name: str) -> str:
        """Returns the path by which USD opens a file. Raises SceneError if the file must not be opened."""
        outer, inner = split_package_path(name)
        path = str(self._files.path(outer))
        return path if inner is None else f"{path}[{inner}]"

    def read(self, name: str) -> bytes:
        """Returns the bytes of a file. Raises SceneError if it cannot be read or is compressed inside its package."""
        outer, inner = split_package_path(name)
        if inner is None:
            return self._files.read(outer)
        package = self._package(outer)
        entry = package.getinfo(inner)
        # Packages are uncompressed, so no file in them is larger than the package.
        if entry.compress_type != zipfile.ZIP_STORED or entry.file_size > min(MAX_FILE_BYTES, self._size(outer)):
            raise SceneError(
                Sentence(
                    "usd-package-compressed",
                    "{name} is compressed, which USD does not allow; package it again with usdzip",
                    name=name,
                )
            )
        try:
            return package.read(entry)
        except (*DAMAGED, OSError) as error:
            raise SceneError(
                Sentence(
                    "usd-package-unreadable",
                    "{name}: could not be read ({error}); package it again",
                    name=name,
                    error=library_message(error),
                )
            ) from error

    def root_of(self, name: str) -> str:
        """Returns the name of the root layer: for a package, its first file; otherwise the name itself.

        Raises SceneError if the package does not begin with a USD layer.
        """
        outer, inner = split_package_path(name)
        if inner is not None or not outer.lower().endswith(_PACKAGE):
            return name
        first = next((entry for entry in self._package(outer).namelist() if not entry.endswith("/")), None)
        if first is None or PurePosixPath(first).suffix.lower() not in LAYER_SUFFIXES[:3]:
            raise SceneError(
                Sentence(
                    "usd-package-without-layer",
                    "{package}: does not begin with a USD layer; package it again with usdzip",
                    package=outer,
                )
            )
        return f"{outer}[{first}]"

    def tiles(self, reference: str, beside: str) -> dict[int, str]:
        """Returns the files of a UDIM texture by tile number, 1001 to 1100."""
        package, inner = split_package_path(beside)

        def find(name: str) -> str | None:
            at = self._in_package(package, name, inner) if inner is not None else None
            return at or self._files.find(name, package)

        return tiles_of(reference, find)

    def _in_package(self, package: str, file_name: str, beside: str) -> str | None:
        if package not in self._names:
            listed = sorted(self._package(package).namelist())
            self._names[package] = set(listed), {posixpath.basename(name): name for name in reversed(listed)}
        names, by_bare_name = self._names[package]
        near = posixpath.normpath(posixpath.join(posixpath.dirname(beside), file_name))
        for name in (near, posixpath.normpath(file_name).lstrip("/")):
            if name in names:
                return f"{package}[{name}]"
        bare = by_bare_name.get(posixpath.basename(file_name)) if posixpath.basename(file_name) else None
        return f"{package}[{bare}]" if bare is not None else None

    def _size(self, outer: str) -> int:
        return self._files.path(outer).stat().st_size

    def _package(self, outer: str) -> zipfile.ZipFile:
        if outer not in self._packages:
            try:
                self._packages[outer] = zipfile.ZipFile(io.BytesIO(self._files.read(outer)))
            except DAMAGED as error:
                raise SceneError(
                    Sentence(
                        "usd-package-damaged",
                        "{package}: is not a valid .usdz package. Package it again ({error})",
                        package=outer,
                        error=library_message(error),
                    )
                ) from error
        return self._packages[outer]


def split_package_path(name: str) -> tuple[str, str | None]:
    """Splits the name of a file in a package into (package, inner file); returns (name, None) for other files."""
    at = name.find(f"{_PACKAGE}[")
    if at < 0 or not name.endswith("]"):
        return name, None
    return name[: at + len(_PACKAGE)], name[at + len(_PACKAGE) + 1 : -1]
