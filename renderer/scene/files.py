"""Access to a scene's folder and nothing outside it: the only way by which readers open files.

Scenes are untrusted. Every file name is resolved below the folder; absolute paths, `..` and symbolic links that lead out of it
are never opened.
"""

from __future__ import annotations

import base64
import binascii
import contextlib
import functools
import os
import unicodedata
from collections import Counter
from collections.abc import Callable, Hashable
from pathlib import Path, PurePosixPath
from typing import Any, TypeVar
from urllib.parse import unquote, unquote_to_bytes

from renderer.confine.faults import is_of_machine
from renderer.errors import SceneError
from renderer.frames import frame_name, numbers_of
from renderer.library_messages import library_message
from renderer.scene.text_encoding import is_readable, possible_decodings
from renderer.sentences import Sentence

__all__ = ["MAX_FILE_BYTES", "SceneFiles", "case_folded", "data_uri"]

MAX_FILE_BYTES = 2 << 30
MAX_DATA_URI_BYTES = 256 << 20
MAX_SEARCHED = 20_000  # files searched for one that is not at its stated path
_MOST_CHARACTERS = 4096  # of a reference: no system has a longer path
_MOST_PARTS = 64  # only the last parts of a reference are used: earlier ones are directories of another machine

Made = TypeVar("Made")


class SceneFiles:
    """The files below one folder. Their names are relative to it, with forward slashes.

    environment: the name of an uploaded environment image that is not part of the scene.
    """

    def __init__(self, folder: Path, environment: str | None = None) -> None:
        if not folder.is_dir():
            raise SceneError(
                Sentence(
                    "scene-folder-missing",
                    "{name} is not a folder; give the folder of the scene's files",
                    name=folder.name,
                )
            )
        self._root = folder.resolve()
        self._environment = environment
        self._made: dict[Hashable, Any] = {}
        self._used: set[Hashable] = set()
        self._found: dict[tuple[str, str], str | None] = {}
        self._listed: dict[str, dict[str, list[str]]] = {}
        self.encodings: Counter[str] = Counter()  # in which non-UTF-8 names led to existing files
        self.is_numbered = False  # whether the name of any file read contains the frame's number

    def read_anew(self) -> None:
        """Prepares for reading another frame: drops cached values that the last frame did not use.

        Otherwise the data of numbered files would accumulate.
        """
        self._made = {key: made for key, made in self._made.items() if key in self._used}
        self._used = set()
        self._found.clear()
        self._listed.clear()

    def get_or_make(self, key: Hashable, make: Callable[[], Made]) -> Made:
        """Returns the value cached under `key`, else the result of `make()`: data that is the same in all frames is read once.

        Callers must not modify the value. None is not cached.
        """
        self._used.add(key)
        if key in self._made:
            found: Made = self._made[key]
            return found
        made = make()
        if made is not None:
            self._made[key] = made
        return made

    def store(self, key: Hashable, value: Any) -> None:
        """Caches a value for this and later frames; `stored` returns it."""
        self._used.add(key)
        self._made[key] = value

    def stored(self, key: Hashable) -> Any:
        """Returns the value that was cached under `key`; None if there is none.

        If there is one, all other cached values are kept for the next frame too.
        """
        if key in self._made:
            self._used = set(self._made)
        return self._made.get(key)

    def path(self, name: str) -> Path:
        """Returns the path of a file of the scene, for libraries that open the file themselves.

        Raises SceneError under the conditions of `read`.
        """
        path = self._inside(name)
        if path is None:
            raise SceneError(
                Sentence(
                    "path-outside-scene-folder",
                    "{name}: leads out of the scene's folder; put the file beside the scene",
                    name=name[:200],
                )
            )
        if not self._is_file(name):
            raise SceneError(Sentence("file-not-in-scene", "{name} is not among the scene's files; add it", name=name[:200]))
        size = path.stat().st_size
        if size > MAX_FILE_BYTES:
            raise SceneError(
                Sentence(
                    "scene-file-too-large",
                    "{name} is {gib} GiB; a file of a scene may have at most {most_gib} GiB",
                    name=name,
                    gib=f"{size / 2**30:.1f}",
                    most_gib=MAX_FILE_BYTES >> 30,
                )
            )
        return path

    def read(self, name: str) -> bytes:
        """Returns the bytes of a file of the scene.

        Raises SceneError if it is missing, too large, not a regular file, or outside the folder.
        """
        path = self.path(name)
        try:
            return path.read_bytes()
        except OSError as error:
            if is_of_machine(error):
                raise
            raise SceneError(
                Sentence("file-os-error", "{name}: could not be read ({error})", name=name, error=library_message(error))
            ) from error

    def at_frame(self, pattern: str, frame: float, beside: str) -> str:
        """Returns the name of a pattern's file at a frame: the pattern with the frame number in place of #.

        Returns the pattern unchanged if a file has that very name. beside: the scene file that the pattern is relative to.
        """
        if "#" not in PurePosixPath(pattern).name or self.find(pattern, beside) is not None:
            return pattern
        self.is_numbered = True
        return str(PurePosixPath(pattern).with_name(frame_name(PurePosixPath(pattern).name, int(frame))))

    def frames_of(self, pattern: str) -> list[int]:
        """Returns the frame numbers for which a file name pattern, such as smoke.####.obj, has files."""
        folder = self._inside(str(PurePosixPath(pattern).parent))
        if "#" not in PurePosixPath(pattern).name or folder is None or not folder.is_dir():
            return []
        return numbers_of(PurePosixPath(pattern).name, [path.name for path in folder.iterdir()])

    def find(self, reference: str, beside: str) -> str | None:
        """Returns the name of the file to which `reference` in the scene file `beside` refers; None if there is none.

        Handles references as written by authoring tools: backslashes, another machine's directories, wrong case, quotes. Tries
        the whole path below the folder of `beside` and below the root, then with fewer and fewer of its leading directories, then
        the bare name in any folder.
        """
        key = (reference, str(PurePosixPath(beside).parent))
        if key not in self._found:
            self._found[key] = self._look_for(reference, PurePosixPath(beside).parent) or self._decoded(*key)
        return self._found[key]

    def _decoded(self, reference: str, home: str) -> str | None:
        """Returns the existing file that a reference in another encoding than UTF-8 names; None if no encoding yields one.

        reference: with lone surrogates for the bytes; the first encoding in which a file exists is used. home: the scene file's
        folder.
        """
        if is_readable(reference):
            return None
        for encoding, text in possible_decodings(reference):
            if found := self._look_for(text, PurePosixPath(home)):
                self.encodings[encoding] += 1
                return found
        return None

    def _look_for(self, reference: str, home: PurePosixPath) -> str | None:
        cleaned = reference.strip().strip("\"'").replace("\\", "/")
        parts = [p for p in cleaned.split("/") if p not in ("", ".") and not p.endswith(":")]
        if not parts or "\0" in cleaned or len(cleaned) > _MOST_CHARACTERS:
            return None
        direct = _joined(home, parts)
        if ".." in parts and direct is not None and (found := self._match(PurePosixPath(), direct)):
            return found
        while ".." in parts:  # `a/../b` is `b`; a leading `..` leads to files that only the author's machine has
            i = parts.index("..")
            del parts[max(i - 1, 0) : i + 1]
        parts = parts[-_MOST_PARTS:]
        for first in range(len(parts)):
            for base in dict.fromkeys((home, PurePosixPath())):
                found = self._match(base, parts[first:])
                if found:
                    return found
        return self._search(parts[-1]) if parts else None

    def is_outside(self, reference: str, beside: str) -> bool:
        """Returns True if a relative reference in the scene file `beside` leads out of the folder."""
        parts = [part for part in reference.replace("\\", "/").split("/") if part not in ("", ".")]
        return _joined(PurePosixPath(beside).parent, parts) is None

    def resolve_uri(self, uri: str, beside: str) -> str | None:
        """Returns the file name for a URI (glTF, Collada), as `find` does, after removing file:. None for other schemes.

        Tries the URI as written, then with percent escapes decoded, then both without query and fragment.
        """
        if uri.lower().startswith("file:"):
            uri = uri[5:]
        elif "://" in uri:
            return None
        bare = uri.partition("#")[0].partition("?")[0]
        tried = dict.fromkeys((uri, unquote(uri), bare, unquote(bare)))
        return next((found for name in tried if (found := self.find(name, beside)) is not None), None)

    def has(self, name: str) -> bool:
        """Returns True if the scene has a regular file of exactly this name."""
        return self._is_file(name)

    def siblings(self, beside: str, suffixes: tuple[str, ...]) -> list[str]:
        """Returns the names of regular files in the folder of `beside` that end in one of the suffixes, sorted."""
        home = PurePosixPath(beside).parent
        folder = self._inside(str(home))
        if folder is None:
            return []
        names = sorted(e.name for e in os.scandir(folder) if e.is_file() and not e.name.startswith("."))
        found = [str(home / n) for n in names if n.lower().endswith(suffixes)]
        return [name for name in found if name != self._environment]

    def _inside(self, name: str) -> Path | None:
        if "\0" in name or "\\" in name or PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts:
            return None
        try:
            path = (self._root / name).resolve()
        except (OSError, RuntimeError):  # a name too long, a loop of links
            return None
        return path if path == self._root or self._root in path.parents else None

    def _match(self, base: PurePosixPath, parts: list[str]) -> str | None:
        if str(base) not in self._listed:  # else a lookup there is faster and has a better error
            exact = str(base.joinpath(*parts))
            if self._is_file(exact):
                return exact
        here = base
        for part in parts:
            wanted = self._names_in(str(here)).get(case_folded(part))
            if not wanted:
                return None
            here = here / (part if part in wanted else wanted[0])
        return str(here) if self._is_file(str(here)) else None

    def _names_in(self, name: str) -> dict[str, list[str]]:
        """Returns the files of one folder: case-folded name -> the names that fold to it.

        The folder is listed once, since a scene may refer to a hundred thousand textures.
        """
        if name not in self._listed:
            found: dict[str, list[str]] = {}
            folder = self._inside(name)
            with contextlib.suppress(OSError):
                for each in sorted(e.name for e in folder.iterdir()) if folder is not None and folder.is_dir() else ():
                    found.setdefault(case_folded(each), []).append(each)
            self._listed[name] = found
        return self._listed[name]

    def _search(self, name: str) -> str | None:
        found = self._by_name.get(case_folded(name))
        return found if found and self._is_file(found) else None

    @functools.cached_property
    def _by_name(self) -> dict[str, str]:
        """Returns case-folded name without folders -> the first file of that name in any folder of the scene.

        Only the first MAX_SEARCHED files are considered.
        """
        found: dict[str, str] = {}
        seen = 0
        for folder, folders, files in os.walk(self._root):
            folders[:] = sorted(d for d in folders if not d.startswith("."))
            for file in sorted(files)[: MAX_SEARCHED - seen]:
                found.setdefault(case_folded(file), (Path(folder) / file).relative_to(self._root).as_posix())
            seen += len(files)
            if seen >= MAX_SEARCHED:
                break
        return found

    def _is_file(self, name: str) -> bool:
        path = self._inside(name)
        try:
            return path is not None and path.is_file()
        except OSError:
            return False


def case_folded(name: str) -> str:
    """Returns a name normalised for comparison: Unicode normal form and case folded."""
    return name.lower() if name.isascii() else unicodedata.normalize("NFC", unicodedata.normalize("NFC", name).casefold())


def _joined(home: PurePosixPath, parts: list[str]) -> list[str] | None:
    """Returns the parts of a path relative to the folder `home`, with `..` resolved; None if they lead out of the scene."""
    found = list(home.parts)
    for part in parts:
        if part != "..":
            found.append(part)
        elif found:
            found.pop()
        else:
            return None
    return found


def data_uri(uri: str, where: str) -> bytes:
    """Returns the bytes of a data: URI. Raises SceneError if it is damaged or too large; `where` is for error messages."""
    header, comma, body = uri.partition(",")
    if not comma:
        raise SceneError(Sentence("data-uri-empty", "{place}: its data URI has no data; export the file again", place=where))
    if len(body) > MAX_DATA_URI_BYTES:
        raise SceneError(
            Sentence(
                "data-uri-too-large",
                "{place}: its data URI has {mib} MiB; put such data in a file beside the scene",
                place=where,
                mib=len(body) >> 20,
            )
        )
    if not header.lower().endswith(";base64"):
        return unquote_to_bytes(body)
    try:
        return base64.b64decode(unquote(body) if "%" in body else body, validate=False)
    except (binascii.Error, ValueError) as error:
        raise SceneError(
            Sentence(
                "data-uri-damaged",
                "{place}: its data URI is damaged ({error}); export the file again",
                place=where,
                error=library_message(error),
            )
        ) from error
