"""The page's files. Addresses in index.html contain a hash of all files, so these never need to be revalidated.

A page of an older release that is still loading asks with an older hash, and is given the current files; index.html itself is
revalidated each time, so the next load is consistent.
"""

from __future__ import annotations

import gzip
import hashlib
import mimetypes
import posixpath
import re
import threading
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from fastapi.staticfiles import StaticFiles
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers
from starlette.responses import Response
from starlette.types import Scope

__all__ = ["Pages", "WebPages"]

FOLDER = "v"  # v/HASH/js/main.js
PARTS = ("js", "css", "words", "examples")
FOREVER = "public, max-age=31536000, immutable"
PACKED = (".js", ".css", ".svg", ".html", ".json")
_NAMED = re.compile(r'\b(href|src)="((?:js|css)/[^"]+|icon\.svg)"')
_MODULE = re.compile(r'<script type="module" src="([^"]+)"')
_IMPORT = re.compile(r'^(?:import|export|\})[^"\n]*"(\.{1,2}/[^"]+)"', re.MULTILINE)

mimetypes.add_type("text/javascript", ".js")


class Pages(StaticFiles):
    """Files with an ETag, asked about anew each time: a page never mixes files of two versions."""

    async def get_response(self, path: str, scope: Scope) -> Response:
        """A file; none that is hidden."""
        if _is_hidden(Path(path)):
            path = "no such file"
        answer = await super().get_response(path, scope)
        answer.headers["Cache-Control"] = "no-cache"
        return answer


class WebPages(Pages):
    """The page: its index by itself, all that it is made of under an address that changes with it, compressed once."""

    def __init__(self, folder: Path) -> None:
        super().__init__(directory=folder, html=True)
        self._folder = folder
        self._shelf = Shelf(folder, ())
        self._lock = threading.Lock()

    async def get_response(self, path: str, scope: Scope) -> Response:
        """The index, a file of a version, or any other file."""
        if scope["method"] not in ("GET", "HEAD"):
            return await super().get_response(path, scope)  # which says what can be done
        if path in (".", "index.html"):
            shelf = await run_in_threadpool(self._latest)
            return _answer(shelf.index, "index.html", "no-cache", scope)
        first, _, rest = path.partition("/")
        if first != FOLDER:
            return await super().get_response(path, scope)
        version, _, name = rest.partition("/")
        shelf = self._shelf if version == self._shelf.version else await run_in_threadpool(self._latest)
        lasts = FOREVER if version == shelf.version else "no-store"
        if (content := shelf.contents.get(name)) is not None:
            return _answer(content, name, lasts, scope)
        return await super().get_response("no such file", scope)

    def _latest(self) -> Shelf:
        """As the files are now: whoever works on the page reloads it, and restarts nothing."""
        with self._lock:
            files = tuple(_files(self._folder))
            if files != self._shelf.files:
                self._shelf = Shelf(self._folder, files)
            return self._shelf


@dataclass(frozen=True)
class Content:
    """A file's content, plain and compressed."""

    plain: bytes

    @cached_property
    def packed(self) -> bytes:
        """As gzip, the same bytes for the same content."""
        return gzip.compress(self.plain, 9, mtime=0)

    @cached_property
    def tag(self) -> str:
        """Its ETag."""
        return f'"{hashlib.sha256(self.plain).hexdigest()[:24]}"'


@dataclass(frozen=True)
class Shelf:
    """All files of the page as they were at a moment. files: their names, sizes and times."""

    folder: Path
    files: tuple[tuple[str, int, int], ...]
    contents: dict[str, Content] = field(init=False)
    version: str = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "contents", {name: Content((self.folder / name).read_bytes()) for name, *_ in self.files})
        whole = hashlib.sha256()
        for name, content in self.contents.items():
            whole.update(f"{name}\0{len(content.plain)}\0".encode() + content.plain)
        object.__setattr__(self, "version", whole.hexdigest()[:16])

    @cached_property
    def index(self) -> Content:
        """index.html, which names the files by their version, and at once all modules that they import."""
        html = self.contents["index.html"].plain.decode() if "index.html" in self.contents else ""
        modules = [name for first in _MODULE.findall(html) for name in self._imported(first)]
        links = "".join(f'<link rel="modulepreload" href="{name}" />\n    ' for name in modules)
        html = html.replace("<script", f"{links}<script", 1)
        return Content(_NAMED.sub(rf'\1="{FOLDER}/{self.version}/\2"', html).encode())

    def _imported(self, module: str) -> list[str]:
        """A module and all that it imports, directly or not, those that are needed first at the beginning."""
        found = {module: None}
        for name in (waiting := [module]):
            source = self.contents[name].plain.decode() if name in self.contents else ""
            for relative in _IMPORT.findall(source):
                other = posixpath.normpath(posixpath.join(posixpath.dirname(name), relative))
                if other in self.contents and other not in found:
                    found[other] = None
                    waiting.append(other)
        return list(found)


def _files(folder: Path) -> list[tuple[str, int, int]]:
    """Name, size and time of every file of the page, in order."""
    found = []
    for path in [*folder.glob("*"), *(path for part in PARTS for path in folder.glob(f"{part}/**/*"))]:
        name = path.relative_to(folder)
        if not _is_hidden(name) and path.is_file():
            known = path.stat()
            found.append((name.as_posix(), known.st_size, known.st_mtime_ns))
    return sorted(found)


def _is_hidden(name: Path) -> bool:
    return any(part.startswith((".", "node_modules")) for part in name.parts if part != ".")


def _answer(content: Content, name: str, lasts: str, scope: Scope) -> Response:
    """A file, compressed for whoever understands that; nothing where it is known already."""
    asked = Headers(scope=scope)
    packs = name.endswith(PACKED) and "gzip" in asked.get("accept-encoding", "")
    tag = content.tag[:-1] + '-gzip"' if packs else content.tag
    headers = {"ETag": tag, "Cache-Control": lasts, "Vary": "Accept-Encoding"}
    if tag in asked.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    if packs:
        headers["Content-Encoding"] = "gzip"
    kind = mimetypes.guess_type(name)[0] or "application/octet-stream"
    return Response(content.packed if packs else content.plain, media_type=kind, headers=headers)
