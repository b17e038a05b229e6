"""Serves the page's files. The links in index.html contain a hash of all files, so browsers never need to revalidate the files.

A page of an older release requests files by an older hash. Such a request for a JavaScript module results in 404, since the
page would mix releases; the page then reports this or reloads (`web/js/shell/again.js`). Other files are sent as they are in
this release. index.html is revalidated each time. The typeface is Inter, from the package fontpkg-inter; without the package,
browsers use the system's.
"""

from __future__ import annotations

import gzip
import hashlib
import importlib.util
import mimetypes
import threading
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from urllib.parse import quote

from fastapi.staticfiles import StaticFiles
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.responses import RedirectResponse, Response
from starlette.types import Scope

from service.page_index import index_of, joined_files

__all__ = ["FONT", "Content", "Pages", "WebPages", "file_response", "opens_page"]

FOLDER = "v"  # v/HASH/js/main.js
PAGE_FOLDERS = ("js", "css", "words", "examples")
FONT = "fonts/inter.ttf"  # linked by web/css/tokens.css, service/docs_page and service/share_page
CACHE_FOREVER = "public, max-age=31536000, immutable"
CACHE_FONT = f"public, max-age={30 * 86400}"
COMPRESSED_SUFFIXES = (".js", ".css", ".svg", ".html", ".json", ".ttf")
SOURCES = (".js", ".css", ".html")

mimetypes.add_type("text/javascript", ".js")
mimetypes.add_type("font/ttf", ".ttf")


class Pages(StaticFiles):
    """Static files that browsers revalidate each time by their ETag.

    A page therefore never mixes files of two versions.
    """

    async def get_response(self, path: str, scope: Scope) -> Response:
        """Returns the response with a file. Hidden files result in 404."""
        if _is_hidden(Path(path)):
            path = "no such file"
        answer = await super().get_response(path, scope)
        answer.headers["Cache-Control"] = "no-cache"
        return answer


class WebPages(Pages):
    """Serves index.html, the typeface, and the page's other files at URLs that contain their version.

    Each file is compressed once.
    """

    def __init__(self, folder: Path) -> None:
        super().__init__(directory=folder, html=True)
        self._folder = folder
        self._shelf = PageFiles(folder, ())
        self._font = _font()
        self._lock = threading.Lock()

    async def get_response(self, path: str, scope: Scope) -> Response:
        """Returns the response for a path: index.html, a versioned file, or another file.

        Another address that is opened in a browser, such as /jobs, leads to the page's view of that name; the page says if there
        is none. Programs get a 404.
        """
        try:
            return await self._file(path, scope)
        except HTTPException as error:
            if error.status_code != 404 or not opens_page(scope) or path.partition("/")[0] in ("api", FOLDER):
                raise
            return RedirectResponse(f"/#/{quote(path)}", headers={"Vary": "Accept"})

    async def _file(self, path: str, scope: Scope) -> Response:
        if scope["method"] not in ("GET", "HEAD"):
            return await super().get_response(path, scope)  # responds with the allowed methods
        if path in (".", "index.html"):
            shelf = await run_in_threadpool(self._current_files)
            return file_response(shelf.index, "index.html", "no-cache", scope)
        if path == FONT and self._font is not None:
            return await run_in_threadpool(file_response, self._font, FONT, CACHE_FONT, scope)
        first, _, rest = path.partition("/")
        if first != FOLDER:
            return await super().get_response(path, scope)
        version, _, name = rest.partition("/")
        shelf = self._shelf if version == self._shelf.version else await run_in_threadpool(self._current_files)
        is_of_it = version == shelf.version
        lasts = CACHE_FOREVER if is_of_it else "no-store"
        if (content := shelf.contents.get(name)) is not None and (is_of_it or not name.endswith(".js")):
            return file_response(content, name, lasts, scope)
        return await super().get_response("no such file", scope)

    def _current_files(self) -> PageFiles:
        """Returns the page's files. Reads them again after a change on disk, so that changes need no restart."""
        with self._lock:
            files = tuple(_files(self._folder))
            if files != self._shelf.files:
                self._shelf = PageFiles(self._folder, files)
            return self._shelf


@dataclass(frozen=True)
class Content:
    """A file's content, uncompressed and compressed."""

    plain: bytes

    @cached_property
    def packed(self) -> bytes:
        """The gzip-compressed content; equal content gives equal bytes."""
        return gzip.compress(self.plain, 9, mtime=0)

    @cached_property
    def tag(self) -> str:
        """The ETag of the uncompressed content."""
        return f'"{hashlib.sha256(self.plain).hexdigest()[:24]}"'


@dataclass(frozen=True)
class PageFiles:
    """The content of all files of the page at one moment.

    files: name, size and modification time of each file. version: hash of all files. index: the generated index.html.
    """

    folder: Path
    files: tuple[tuple[str, int, int], ...]
    contents: dict[str, Content] = field(init=False)
    version: str = field(init=False)
    index: Content = field(init=False)  # as served

    def __post_init__(self) -> None:
        contents = {name: Content((self.folder / name).read_bytes()) for name, *_ in self.files}
        whole = hashlib.sha256()
        for name, content in contents.items():
            whole.update(f"{name}\0{len(content.plain)}\0".encode() + content.plain)
        sources = {name: content.plain.decode() for name, content in contents.items() if name.endswith(SOURCES)}
        html, version = sources.get("index.html", ""), whole.hexdigest()[:16]
        contents |= {name: Content(text.encode()) for name, text in joined_files(html, sources).items()}
        object.__setattr__(self, "contents", contents)
        object.__setattr__(self, "version", version)
        object.__setattr__(self, "index", Content(index_of(html, sources, f"{FOLDER}/{version}/").encode()))


def _files(folder: Path) -> list[tuple[str, int, int]]:
    """Returns name, size and modification time of every file of the page, sorted."""
    found = []
    for path in [*folder.glob("*"), *(path for part in PAGE_FOLDERS for path in folder.glob(f"{part}/**/*"))]:
        name = path.relative_to(folder)
        if not _is_hidden(name) and path.is_file():
            known = path.stat()
            found.append((name.as_posix(), known.st_size, known.st_mtime_ns))
    return sorted(found)


def _font() -> Content | None:
    """Returns the variable font of Inter, upright, with axes for optical size and weight; None without its package."""
    package = importlib.util.find_spec("fontpkg_inter")
    if package is None or package.origin is None:
        return None
    path = Path(package.origin).parent / "files" / "Inter[opsz,wght].ttf"
    return Content(path.read_bytes()) if path.is_file() else None


def opens_page(scope: Scope) -> bool:
    """Returns true for a request of a browser that opens an address as a page; programs and scripts do not ask for HTML."""
    return scope["method"] == "GET" and "text/html" in Headers(scope=scope).get("accept", "")


def _is_hidden(name: Path) -> bool:
    return any(part.startswith((".", "node_modules")) for part in name.parts if part != ".")


def file_response(content: Content, name: str, cache_control: str, scope: Scope) -> Response:
    """Returns the response with a file, compressed if the client accepts gzip. Status 304 if the client's ETag matches.

    name: the file's name, which determines the media type. scope: the ASGI scope of the request.
    """
    asked = Headers(scope=scope)
    packs = name.endswith(COMPRESSED_SUFFIXES) and "gzip" in asked.get("accept-encoding", "")
    tag = content.tag[:-1] + '-gzip"' if packs else content.tag
    headers = {"ETag": tag, "Cache-Control": cache_control, "Vary": "Accept-Encoding"}
    if tag in asked.get("if-none-match", ""):
        return Response(status_code=304, headers=headers)
    if packs:
        headers["Content-Encoding"] = "gzip"
    kind = mimetypes.guess_type(name)[0] or "application/octet-stream"
    return Response(content.packed if packs else content.plain, media_type=kind, headers=headers)
