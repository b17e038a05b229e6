"""Serves the guides, which are Markdown files, as pages with the design of the API's documentation."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterator
from html import escape
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from starlette.concurrency import run_in_threadpool
from starlette.responses import Response
from starlette.types import Scope

from renderer import __version__
from service.pages import Content, Pages, file_response

if TYPE_CHECKING:
    from markdown_it import MarkdownIt
    from markdown_it.token import Token

__all__ = ["GROUPS", "Guides"]

# The guides in the order of the index: for people who render, for those who run a farm, and for those who are curious.
GROUPS = {
    "Use": (
        *(
            "page",
            "animation",
            "compositing",
            "color",
            "scene-format",
            "blend-files",
            "blender",
            "python",
            "datasets",
            "watching",
        ),
        *("pipelines", "from-deadline", "api"),
    ),
    "Run a farm": ("deployment", "graphics-cards", "queue", "reliability", "scale"),
    "Background": ("correctness", "performance", "architecture", "lineage", "speed-notes"),
}
PICTURE_SUFFIXES = (".jpg", ".png", ".webp", ".mp4")
INDEX = "index"
TEXT = ("text", "code_inline", "softbreak")


class Guides(Pages):
    """Serves an index of the guides, each guide at its name without the suffix, and the guides' pictures.

    folder: has the Markdown files, and a subfolder `pictures`. template: an HTML page with {title}, {contents}, {body} and
    {version}.
    """

    def __init__(self, folder: Path, template: Path) -> None:
        super().__init__(directory=folder, check_dir=False)
        self._folder = folder
        self._template = template
        self._pages: dict[str, tuple[tuple[int, ...], Content]] = {}

    async def get_response(self, path: str, scope: Scope) -> Response:
        """Returns the response with a guide, the index or a picture. Other files of the folder result in 404."""
        name = INDEX if path == "." else path
        if scope["method"] in ("GET", "HEAD") and (name == INDEX or self._has(name)):
            content = await run_in_threadpool(self._page, name)
            return file_response(content, "guide.html", "no-cache", scope)
        is_picture = PurePosixPath(path).parts[:1] == ("pictures",) and path.endswith(PICTURE_SUFFIXES)
        return await super().get_response(path if is_picture or name == INDEX else "no such file", scope)

    def _has(self, name: str) -> bool:
        return any(name in names for names in GROUPS.values()) and (self._folder / f"{name}.md").is_file()

    def _page(self, name: str) -> Content:
        """Returns the page of a guide, or the index if `name` is INDEX. Renders it again after its files have changed."""
        files = [self._template, *([] if name == INDEX else [self._folder / f"{name}.md"])]
        version = tuple(path.stat().st_mtime_ns for path in files)
        known = self._pages.get(name)
        if known is None or known[0] != version:
            known = self._pages[name] = (version, Content(self._rendered(name).encode()))
        return known[1]

    def _rendered(self, name: str) -> str:
        if name == INDEX:
            title, contents, body = "Guides", "", self._index()
        else:
            title, contents, body = render_guide((self._folder / f"{name}.md").read_text(), self._has)
        parts = {"title": title, "contents": contents, "body": body, "version": __version__}
        page = self._template.read_text()
        return re.sub(r"\{(title|contents|body|version)\}", lambda found: parts[found[1]], page)

    def _index(self) -> str:
        return "<h1>Guides</h1>" + "".join(self._group(group, names) for group, names in GROUPS.items())

    def _group(self, group: str, names: tuple[str, ...]) -> str:
        items = ""
        for name in filter(self._has, names):
            title, about = summary_of((self._folder / f"{name}.md").read_text())
            items += f'<li><a href="{name}">{escape(title)}</a> <span class="about">{escape(about)}</span></li>'
        return f'<h2>{group}</h2><ul class="guides">{items}</ul>' if items else ""


def render_guide(text: str, has_guide: Callable[[str], bool]) -> tuple[str, str, str]:
    """Returns a guide's title, the links to its sections, and its body as HTML.

    text: the guide in Markdown. has_guide: returns True if there is a guide with a given name. Links to other files are
    rendered as plain text.
    """
    parser = _parser()
    tokens = parser.parse(text)
    title, contents = "", ""
    used: dict[str, int] = {}
    for heading, inline in itertools.pairwise(tokens):
        if heading.type != "heading_open":
            continue
        words = _plain_text(inline)
        anchor = _anchor(words, used)
        heading.attrSet("id", anchor)
        if heading.tag == "h1":
            title = title or words
        elif heading.tag == "h2":
            contents += f'<li><a href="#{anchor}">{escape(words)}</a></li>'
    for cell in tokens:
        if cell.type in ("th_open", "td_open") and "right" in str(cell.attrs.pop("style", "")):
            cell.attrSet("class", "right")  # inline styles are forbidden by the Content-Security-Policy
    for token in _inline_tokens(tokens):
        _resolve_link(token, has_guide)
        if token.type == "image":
            token.attrSet("loading", "lazy")
    body = str(parser.renderer.render(tokens, parser.options, {}))
    body = body.replace("<table>", '<div class="wide" tabindex="0"><table>').replace("</table>", "</table></div>")
    body = re.sub(r"<th(?: [^>]*)?></th>", "<td></td>", body)  # of a column without a name
    nav = f'<nav class="contents" aria-label="Contents"><ul>{contents}</ul></nav>' if contents else ""
    return escape(title or "Guide"), nav, body.replace("<pre>", '<pre tabindex="0">')


def summary_of(text: str) -> tuple[str, str]:
    """Returns the title of a guide, and the first sentence of its first paragraph."""
    tokens = _parser().parse(text)
    title = next((_plain_text(tokens[i + 1]) for i, token in enumerate(tokens) if token.type == "heading_open"), "")
    paragraphs = (_plain_text(tokens[i + 1]) for i, token in enumerate(tokens) if token.type == "paragraph_open")
    first = next((words for words in paragraphs if words.strip()), "")
    return title, re.split(r"(?<=\.)\s", first.replace("\n", " "), maxsplit=1)[0]


def _parser() -> MarkdownIt:
    from markdown_it import MarkdownIt  # not at the service's start, where it takes 50 ms

    return MarkdownIt("commonmark").enable(["table", "strikethrough"])


def _inline_tokens(tokens: list[Token]) -> Iterator[Token]:
    for token in tokens:
        yield from token.children or ()


def _plain_text(inline: Token) -> str:
    return "".join(" " if each.type == "softbreak" else each.content for each in inline.children or () if each.type in TEXT)


def _anchor(words: str, used: dict[str, int]) -> str:
    """Returns a heading's id, as GitHub computes it. used: ids so far; a repeated id gets a number."""
    anchor = re.sub(r"[^\w\- ]", "", words.lower()).replace(" ", "-")
    count = used[anchor] = used.get(anchor, -1) + 1
    return f"{anchor}-{count}" if count else anchor


def _resolve_link(token: Token, has_guide: Callable[[str], bool]) -> None:
    """Points a link to another guide's page; removes the target of links to files that are not served."""
    target = token.attrGet("href") if token.type == "link_open" else None
    if not isinstance(target, str):
        return
    parts = urlsplit(target)
    if parts.scheme or not parts.path:
        return
    name = parts.path.removesuffix(".md")
    if has_guide(name):
        token.attrSet("href", name + (f"#{parts.fragment}" if parts.fragment else ""))
    elif not parts.path.startswith("pictures/"):
        del token.attrs["href"]
