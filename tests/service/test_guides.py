"""Tests of the guides that the service serves as HTML: titles, links, anchors, caching, and no other files."""

from __future__ import annotations

import asyncio
import functools
import re
from collections.abc import Callable, Mapping
from pathlib import Path

import httpx
import pytest
from starlette.applications import Starlette
from starlette.routing import Mount

from renderer import __version__
from service.guides import GROUPS, Guides, render_guide
from service.main import DOCS
from tests.helpers import ROOT

NAMES = [name for names in GROUPS.values() for name in names]
TRANSLATED = [f"{path.stem}.{path.parent.name}" for path in (ROOT / "docs").glob("??/*.md")]


class Client:
    """Sends requests to an application that serves the guides of one folder."""

    def __init__(self, folder: Path) -> None:
        self.app = Starlette(routes=[Mount("/docs/guides", Guides(folder, DOCS / "guide.html"))])

    def get(self, path: str, headers: Mapping[str, str] | None = None) -> httpx.Response:
        async def ask() -> httpx.Response:
            async with httpx.AsyncClient(transport=httpx.ASGITransport(self.app), base_url="http://page") as client:
                return await client.get(path, headers=headers)

        return asyncio.run(ask())


@pytest.fixture(scope="module")
def client() -> Client:
    return Client(ROOT / "docs")


@pytest.fixture(scope="module")
def page(client: Client) -> Callable[[str], httpx.Response]:
    """Returns a function that gets a page of the guides by its name; guides link to each other, so each is asked for once."""
    return functools.cache(lambda name: client.get(f"/docs/guides/{name}"))


def test_guides_are_listed_once() -> None:
    assert sorted(NAMES) == sorted(path.stem for path in (ROOT / "docs").glob("*.md"))


def test_the_index_links_to_every_guide_and_states_the_version(client: Client) -> None:
    page = client.get("/docs/guides/").text
    assert re.findall(r'<li><a href="([^"]+)"', page) == NAMES
    assert f"Rayfarm {__version__}" in page


def test_the_index_states_what_each_guide_is_for_in_a_whole_sentence(client: Client) -> None:
    summaries = re.findall(r'<span class="about">([^<]+)</span>', client.get("/docs/guides/").text)
    assert len(summaries) == len(NAMES)
    assert not [each for each in summaries if not each.endswith(".")]


def test_an_unknown_guide_leads_a_browser_to_the_index(client: Client) -> None:
    assert client.get("/docs/guides/nothing").status_code == 404
    answer = client.get("/docs/guides/nothing", headers={"Accept": "text/html"})
    assert (answer.status_code, answer.headers["location"]) == (307, "/docs/guides/")


@pytest.mark.parametrize("name", [*NAMES, *TRANSLATED])
def test_guide_links_are_valid(page: Callable[[str], httpx.Response], name: str) -> None:
    answer = page(name)
    assert answer.status_code == 200
    assert answer.headers["content-type"].startswith("text/html")
    assert answer.text.count("<h1") == 1
    assert "style=" not in answer.text, "the Content-Security-Policy forbids inline styles"
    body = answer.text.partition("<main>")[2]
    for link in re.findall(r'(?:href|src)="([^"]+)"', body):
        if "://" in link:
            continue
        linked, _, anchor = link.partition("#")
        found = page(linked or name)
        assert found.status_code == 200, link
        assert not anchor or f'id="{anchor}"' in found.text, link


def test_translations_link_to_each_other_and_have_their_language(page: Callable[[str], httpx.Response]) -> None:
    german = page("first-steps.de").text
    assert '<html lang="de">' in german and '<a href="first-steps" lang="en" hreflang="en">' in german
    assert '<a href="first-steps.de" lang="de" hreflang="de">' in page("first-steps").text
    assert page("page.de").status_code == page("first-steps.xx").status_code == 404


def test_only_guides_and_their_pictures_are_served(client: Client) -> None:
    assert client.get("/docs/guides/pictures/page.jpg").headers["content-type"] == "image/jpeg"
    for path in (
        "page.md",
        "settings_table.py",
        "scene-schema.json",
        "figures/lineage.py",
        "../README",
        "%2e%2e/README",
        "nothing",
    ):
        assert client.get(f"/docs/guides/{path}").status_code == 404, path


def test_an_unchanged_guide_is_not_sent_again(client: Client) -> None:
    tag = client.get("/docs/guides/page").headers["etag"]
    assert client.get("/docs/guides/page", headers={"If-None-Match": tag}).status_code == 304


def test_search_finds_sections_by_anchors_of_their_pages(client: Client, page: Callable[[str], httpx.Response]) -> None:
    answer = client.get("/docs/guides/search.json")
    assert answer.headers["content-type"].startswith("application/json")
    sections = answer.json()
    assert {each["guide"] for each in sections} == set(NAMES)
    for each in sections:
        assert not each["anchor"] or f'id="{each["anchor"]}"' in page(each["guide"]).text, each["heading"]
    assert any(each["guide"] == "color" and "OpenColorIO" in each["text"] for each in sections)


def test_guides_are_listed_with_the_current_one_marked(page: Callable[[str], httpx.Response]) -> None:
    side = page("color").text.partition("<main>")[0]
    assert re.findall(r'<a href="([\w-]+)"( aria-current="page")?>', side) == [
        (name, ' aria-current="page"' if name == "color" else "") for name in NAMES
    ]


def test_a_changed_guide_is_rendered_again(tmp_path: Path) -> None:
    (tmp_path / "page.md").write_text("# First\n\nText.\n")
    client = Client(tmp_path)
    assert "First" in client.get("/docs/guides/page").text
    (tmp_path / "page.md").write_text("# Second\n\nText.\n")
    assert "Second" in client.get("/docs/guides/page").text
    assert client.get("/docs/guides/api").status_code == 404, "not in this folder"


def test_links_and_anchors_follow_github() -> None:
    links = "[x](api.md#send-it) [api.md](api.md) [y](../README.md) [z](https://example.org)"
    text = f"# A & B\n\n{links}\n\n## What `it` does?\n\n## What it does\n"
    title, contents, body = render_guide(text, {"api": "REST API"})
    assert title == "A &amp; B"
    assert contents.count("<li>") == 2
    assert '<a href="api#send-it">x</a> <a href="api">REST API</a> y <a href="https://example.org">z</a>' in body
    assert '<h2 id="what-it-does">' in body
    assert '<h2 id="what-it-does-1">' in body


@pytest.mark.parametrize("path", [*(ROOT / "docs").glob("*.md"), *(ROOT / "docs").glob("??/*.md")], ids=lambda path: path.stem)
def test_text_of_links_to_files_that_are_not_served_is_their_path(path: Path) -> None:
    """Such a link is plain text on the farm's page, so the text has to say where the file is."""
    for words, target in re.findall(r"\[([^\]]+)\]\(([^)\s]+)\)", path.read_text(encoding="utf-8")):
        linked = target.partition("#")[0]
        if "://" in target or not linked or linked.removeprefix("../").removesuffix(".md") in NAMES:
            continue
        file = (path.parent / linked).resolve()
        assert file.exists(), target
        if "pictures" not in linked.split("/"):
            said = words.strip("`")
            assert words == f"`{said}`" and file.relative_to(ROOT).as_posix().endswith(said), f"{words} does not name {target}"


def test_numbers_of_a_table_are_aligned_without_inline_styles() -> None:
    body = render_guide("# T\n\n| a | n |\n|---|--:|\n| x | 1 |\n", {})[2]
    assert '<td class="right">1</td>' in body


def test_a_column_without_a_name_has_no_empty_header() -> None:
    body = render_guide("# T\n\n| | n |\n|---|--:|\n| x | 1 |\n", {})[2]
    assert body.count("<th") - body.count("<thead") == 1
    assert "<thead" not in render_guide("# T\n\n| | |\n|---|--:|\n| x | 1 |\n", {})[2]
