"""Serves the guides, which are Markdown files, as pages with the design of the API's documentation."""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Iterator, Mapping
from html import escape
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from starlette.concurrency import run_in_threadpool
from starlette.responses import RedirectResponse, Response
from starlette.types import Scope

from renderer import __version__
from service.pages import Content, Pages, file_response, opens_page

if TYPE_CHECKING:
    from markdown_it import MarkdownIt
    from markdown_it.token import Token

__all__ = ["GROUPS", "Guides"]

# The guides in the order of the index: by what a reader wants to do.
GROUPS = {
    "Start here": ("first-steps", "page"),
    "Make pictures": ("animation", "compositing", "color", "watching"),
    "Files and Blender": ("formats", "usd", "mitsuba-pbrt", "blender", "blend-files"),
    "Write scene files": (
        "scene-format",
        "scene-format-cameras",
        "scene-format-lights",
        "scene-format-materials",
        "scene-format-metallic-roughness",
        "scene-format-textures",
        "scene-format-shapes",
        "scene-format-hair",
        "scene-format-media",
        "scene-format-settings",
    ),
    "Write programs": ("python", "datasets", "pipelines", "from-deadline"),
    "REST API": ("api", "api-jobs", "api-shots", "api-pictures", "api-access", "live"),
    "Run a farm": ("deployment", "server", "access", "remote-workers", "containers", "cluster"),
    "Keep it running": ("monitoring", "reliability", "queue", "settings", "graphics-cards", "scale"),
    "Background": ("correctness", "performance", "architecture", "lineage", "fault-tests", "speed-notes"),
}
PICTURE_SUFFIXES = (".jpg", ".png", ".webp", ".mp4")
INDEX, SEARCH = "index", "search.json"
# Folders of translated guides, and the link to each from the English one. A translation of NAME is served as NAME.LANGUAGE.
LANGUAGES = {"de": "Auf Deutsch lesen"}
TEXT = ("text", "code_inline", "softbreak")


class Guides(Pages):
    """Serves an index of the guides, each guide at its name without the suffix, the guides' pictures, and a text to search.

    folder: has the Markdown files, and a subfolder `pictures`. template: an HTML page with {title}, {guides}, {contents},
    {body}, {next} and {version}.
    """

    def __init__(self, folder: Path, template: Path) -> None:
        super().__init__(directory=folder, check_dir=False)
        self._folder = folder
        self._template = template
        self._pages: dict[str, tuple[tuple[int, ...], Content]] = {}

    async def get_response(self, path: str, scope: Scope) -> Response:
        """Returns the response with a guide, the index or a picture. Other names result in 404; browsers get the index."""
        name = INDEX if path == "." else path
        if scope["method"] in ("GET", "HEAD") and (name in (INDEX, SEARCH) or self._has(name)):
            content = await run_in_threadpool(self._page, name)
            return file_response(content, SEARCH if name == SEARCH else "guide.html", "no-cache", scope)
        if opens_page(scope) and not PurePosixPath(path).suffix:
            return RedirectResponse("/docs/guides/", headers={"Vary": "Accept"})  # an unknown guide, in a browser
        is_picture = PurePosixPath(path).parts[:1] == ("pictures",) and path.endswith(PICTURE_SUFFIXES)
        return await super().get_response(path if is_picture or name == INDEX else "no such file", scope)

    def _has(self, name: str) -> bool:
        english, _, language = name.partition(".")
        is_known = any(english in names for names in GROUPS.values()) and (not language or language in LANGUAGES)
        return is_known and self._file(name).is_file()

    def _file(self, name: str) -> Path:
        english, _, language = name.partition(".")
        return self._folder / language / f"{english}.md"

    def _names(self) -> list[str]:
        return [name for names in GROUPS.values() for name in names if self._has(name)]

    def _text(self, name: str) -> str:
        return self._file(name).read_text(encoding="utf-8")

    def _page(self, name: str) -> Content:
        """Returns the page of a guide, of the index (INDEX) or the text to search (SEARCH). Renders it again after a change."""
        files = [self._template, *map(self._file, {*self._names(), *([] if name in (INDEX, SEARCH) else [name])})]
        version = tuple(path.stat().st_mtime_ns for path in files)
        known = self._pages.get(name)
        if known is None or known[0] != version:
            text = self._search_text() if name == SEARCH else self._rendered(name)
            known = self._pages[name] = (version, Content(text.encode()))
        return known[1]

    def _rendered(self, name: str) -> str:
        if name == INDEX:
            title, contents, body = "Guides", "", self._index()
        else:
            titles = {each: _title(self._text(each)) for each in self._names()}
            title, contents, body = render_guide(self._text(name), titles)
        english, _, language = name.partition(".")
        parts = {"title": title, "contents": contents, "body": body, "version": __version__, "language": language or "en"}
        parts |= {"guides": self._list(english), "next": self._neighbours(english), "translations": self._translations(name)}
        return re.sub(r"\{(\w+)\}", lambda found: parts[found[1]], self._template.read_text(encoding="utf-8"))

    def _search_text(self) -> str:
        """Returns all sections of all guides as JSON, each with the fields that `service/docs_page/guide.js` reads."""
        return json.dumps([each for name in self._names() for each in sections_of(name, self._text(name))], ensure_ascii=False)

    def _list(self, current: str) -> str:
        """Returns the list of all guides by group, in which the current one is marked. Empty for the index."""
        if current == INDEX:
            return ""
        html = ""
        for group, names in GROUPS.items():
            items = "".join(self._link(name, name == current) for name in names if self._has(name))
            html += f'<p class="group">{group}</p><div role="list">{items}</div>' if items else ""
        return f'<details class="folding" open><summary>All guides</summary><nav aria-label="Guides">{html}</nav></details>'

    def _link(self, name: str, is_current: bool) -> str:
        current = ' aria-current="page"' if is_current else ""
        return f'<div role="listitem"><a href="{name}"{current}>{escape(_title(self._text(name)))}</a></div>'

    def _translations(self, name: str) -> str:
        """Returns links from a guide to its other languages."""
        english, _, language = name.partition(".")
        links = {f"{english}.{each}": (each, words) for each, words in LANGUAGES.items() if each != language}
        links |= {english: ("en", "Read in English")} if language else {}
        return " ".join(
            f'<a href="{each}" lang="{tag}" hreflang="{tag}">{words}</a>'
            for each, (tag, words) in links.items()
            if self._has(each)
        )

    def _neighbours(self, name: str) -> str:
        """Returns links to the guides before and after one. Empty for the index."""
        names = self._names()
        if name not in names:
            return ""
        at = names.index(name)
        before = f'<a rel="prev" href="{names[at - 1]}">← {escape(_title(self._text(names[at - 1])))}</a>' if at else ""
        after = names[at + 1] if at + 1 < len(names) else None
        return f'{before}<a rel="next" href="{after}">{escape(_title(self._text(after)))} →</a>' if after else before

    def _index(self) -> str:
        return "<h1>Guides</h1>" + "".join(self._group(group, names) for group, names in GROUPS.items())

    def _group(self, group: str, names: tuple[str, ...]) -> str:
        items = ""
        for name in filter(self._has, names):
            title, about = summary_of(self._text(name))
            items += f'<li><a href="{name}">{escape(title)}</a> <span class="about">{escape(about)}</span></li>'
        return f'<h2>{group}</h2><ul class="guides">{items}</ul>' if items else ""


def render_guide(text: str, titles: Mapping[str, str]) -> tuple[str, str, str]:
    """Returns a guide's title, the links to its sections, and its body as HTML.

    text: the guide in Markdown. titles: of all guides, by name. A link whose text is a guide's file name gets its title. Links
    to other files have the file's path as their text, and are rendered without the link.
    """
    from markdown_it.token import Token

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
    for token, following in itertools.pairwise([*_inline_tokens(tokens), Token("", "", 0)]):
        _resolve_link(token, following, titles)
        if token.type == "image":
            token.attrSet("loading", "lazy")
            token.attrSet("src", str(token.attrGet("src")).removeprefix("../"))
    body = re.sub(r"<a>(.*?)</a>", r"\1", str(parser.renderer.render(tokens, parser.options, {})), flags=re.DOTALL)
    body = body.replace("<table>", '<div class="wide" tabindex="0"><table>').replace("</table>", "</table></div>")
    body = re.sub(r"<thead>\s*<tr>\s*(<th(?: [^>]*)?></th>\s*)+</tr>\s*</thead>", "", body)  # of columns without names
    body = re.sub(r"<th(?: [^>]*)?></th>", "<td></td>", body)
    body = re.sub(r'(<h[23] id="([^"]+)">)(.*)(</h[23]>)', _with_anchor, body)
    nav = f'<details class="folding" open><summary>On this page</summary><ul>{contents}</ul></details>' if contents else ""
    nav = f'<nav class="contents" aria-label="On this page">{nav}</nav>' if nav else ""
    return escape(title or "Guide"), nav, body.replace("<pre>", '<pre tabindex="0">')


def sections_of(name: str, text: str) -> list[dict[str, str]]:
    """Returns the sections of a guide, without its code: `guide`, `title`, `anchor`, `heading` and `text` of each.

    The part before the first heading has the guide's title as its heading, and no anchor.
    """
    title = _title(text)
    used: dict[str, int] = {}
    found = [{"guide": name, "title": title, "anchor": "", "heading": title, "text": ""}]
    tokens = _parser().parse(text)
    for token, inline in itertools.pairwise(tokens):
        if inline.type != "inline":
            continue
        words = _plain_text(inline)
        if token.type != "heading_open":
            found[-1]["text"] += words + " "
            continue
        anchor = _anchor(words, used)
        if token.tag != "h1":
            found.append({"guide": name, "title": title, "anchor": anchor, "heading": words, "text": ""})
    return found


def summary_of(text: str) -> tuple[str, str]:
    """Returns the title of a guide, and the first sentence of its first paragraph."""
    tokens = _parser().parse(text)
    title = next((_plain_text(tokens[i + 1]) for i, token in enumerate(tokens) if token.type == "heading_open"), "")
    paragraphs = (_plain_text(tokens[i + 1]) for i, token in enumerate(tokens) if token.type == "paragraph_open")
    first = next((words for words in paragraphs if words.strip()), "")
    return title, re.split(r"(?<=\.)\s", first.replace("\n", " "), maxsplit=1)[0]


def _title(text: str) -> str:
    """Returns the text of the first heading, which has no markup."""
    return next((line.removeprefix("# ") for line in text.splitlines() if line.startswith("# ")), "Guide")


def _with_anchor(heading: re.Match[str]) -> str:
    """Returns a heading with a link to itself, which readers copy."""
    begin, anchor, words, end = heading.groups()
    return f'{begin}{words} <a class="anchor" href="#{anchor}" aria-label="Link to this section">#</a>{end}'


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


def _resolve_link(token: Token, following: Token, titles: Mapping[str, str]) -> None:
    """Points a link to another guide's page. Removes the target of other links, whose text is a file's path."""
    target = token.attrGet("href") if token.type == "link_open" else None
    if not isinstance(target, str):
        return
    parts = urlsplit(target)
    if parts.scheme or not parts.path:
        return
    name = parts.path.removeprefix("../").removesuffix(".md")  # a translation is in a folder
    if name in titles:
        token.attrSet("href", name + (f"#{parts.fragment}" if parts.fragment else ""))
        if following.content == parts.path:
            following.content = titles[name]
    elif not parts.path.startswith("pictures/"):
        del token.attrs["href"]
