"""Tests of the web page's files: cached permanently under an address with their version, and compressed.

A page never gets files of two versions.
"""

from __future__ import annotations

import asyncio
import gzip
import importlib.util
import io
import json
import os
import re
from collections.abc import Mapping
from pathlib import Path

import httpx
import pytest
from PIL import ImageFont
from starlette.applications import Starlette

from service.page_index import index_of
from service.pages import FONT, WebPages
from tests.helpers import ROOT

INDEX = """<!doctype html>
<link rel="icon" href="icon.svg" />
<link rel="stylesheet" href="css/a.css" />
<link rel="stylesheet" href="css/b.css" />
<script src="js/theme.js"></script>
<script src="js/ahead.js"></script>
<script type="module" src="js/main.js"></script>
<a href="/docs">docs</a>
"""


@pytest.fixture
def web(tmp_path: Path) -> Path:
    files = {
        "index.html": INDEX,
        "icon.svg": "<svg/>",
        "css/a.css": "a {}",
        "css/b.css": "b {}",
        "js/theme.js": "0;",
        "js/ahead.js": "1;",
        "js/main.js": 'import { b } from "./base/b.js";\nimport {\n  c,\n} from "./base/c.js";\nb(c);\n'
        'const d = await import("./views/d.js");\n',
        "js/views/d.js": '/** @type {import("./none.js").X} */\nimport { c } from "../base/c.js";\nimport { e } from "./e.js";\n',
        "js/views/e.js": "export const e = 5;\n",
        "js/base/b.js": 'import { c } from "./c.js";\nexport const b = (x) => x + c;\n',
        "js/base/c.js": "export const c = 1;\n",
        "js/base/unused.js": "",
        "examples/a.jpg": "a picture",
        "node_modules/x.js": "no",
        ".hidden.js": "no",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


class Pages:
    """A client that calls the application without a server."""

    def __init__(self, web: Path) -> None:
        self.app = Starlette()
        self.app.mount("/", WebPages(web))

    def get(self, path: str, headers: Mapping[str, str] | None = None) -> httpx.Response:
        async def ask() -> httpx.Response:
            async with httpx.AsyncClient(transport=httpx.ASGITransport(self.app), base_url="http://page") as client:
                return await client.get(path, headers={"Accept-Encoding": "identity", **(headers or {})})

        return asyncio.run(ask())

    def version(self) -> str:
        found = re.search(r'src="v/(\w+)/js/main.js"', self.get("/").text)
        assert found
        return found[1]


@pytest.fixture
def pages(web: Path) -> Pages:
    return Pages(web)


def test_index_links_versioned_files_and_preloads_modules(pages: Pages) -> None:
    html = pages.get("/").text
    v = f"v/{pages.version()}"
    assert re.findall(r'(?:href|src)="([^"]+)"', html) == [
        f"{v}/icon.svg",
        f"{v}/css/joined.css",
        f"{v}/js/joined.js",
        *(f"{v}/js/{name}.js" for name in ("main", "base/b", "base/c")),
        f"{v}/js/main.js",
        "/docs",
    ]
    assert pages.get("/index.html").text == html
    assert pages.get(f"/{v}/css/joined.css").text == "a {}\nb {}"
    assert pages.get(f"/{v}/js/joined.js").text == "0;\n1;"


def test_index_lists_modules_of_each_view(pages: Pages) -> None:
    table = re.search(r'<script type="application/json" id="view-modules">(.*?)</script>', pages.get("/").text)
    assert table
    assert json.loads(table[1]) == {"d": [f"v/{pages.version()}/js/views/{name}.js" for name in "de"]}


def test_index_lists_views_by_url() -> None:
    """The index lists every view's address, and the page has no other list: views missing there are not shown."""
    web = ROOT / "web"
    sources = {path.relative_to(web).as_posix(): path.read_text() for path in web.rglob("*.js")}
    html = index_of((web / "index.html").read_text(), sources, "v/1/")
    table = re.search(r'<script type="application/json" id="view-addresses">(.*?)</script>', html)
    assert table
    views = json.loads(table[1])
    assert views == {
        "": "home",
        "account": "account",
        "compare/ID": "compare",
        "jobs": "jobs",
        "jobs/ID": "job",
        "scenes/ID": "scene",
        "workers": "workers",
    }
    assert len(views) == sources["js/views/showing.js"].count('await import("./')


def test_addresses_without_a_file_open_the_page_in_a_browser_only(pages: Pages) -> None:
    browser = {"Accept": "text/html,application/xhtml+xml,*/*;q=0.8"}
    answer = pages.get("/jobs/a%20b%22?x=1", browser)
    assert answer.status_code == 307
    assert answer.headers["location"] == "/#/jobs/a%20b%22"
    assert pages.get("/jobs").status_code == 404
    for path in ("/api/nothing", "/v/0/js/main.js"):
        assert pages.get(path, browser).status_code == 404


def test_versioned_files_are_immutable_and_index_is_revalidated(pages: Pages) -> None:
    answer = pages.get(f"/v/{pages.version()}/js/base/b.js")
    assert answer.headers["cache-control"] == "public, max-age=31536000, immutable"
    assert answer.headers["content-type"].startswith("text/javascript")
    assert "immutable" in pages.get(f"/v/{pages.version()}/examples/a.jpg").headers["cache-control"]
    index = pages.get("/")
    assert index.headers["cache-control"] == "no-cache"
    assert pages.get("/", {"If-None-Match": index.headers["etag"]}).status_code == 304


def test_compressed_files_are_equal(pages: Pages) -> None:
    path = f"/v/{pages.version()}/js/main.js"
    plain, packed = pages.get(path), pages.get(path, {"Accept-Encoding": "gzip, br"})
    assert packed.headers["content-encoding"] == "gzip" and packed.content == plain.content
    assert packed.headers["vary"] == plain.headers["vary"] == "Accept-Encoding"
    assert packed.headers["etag"] != plain.headers["etag"]
    assert int(packed.headers["content-length"]) == len(gzip.compress(plain.content, 9))


def test_old_page_gets_no_module_of_new_release(pages: Pages, web: Path) -> None:
    before = pages.version()
    (web / "js/base/c.js").write_text("export const c = 2;\n")
    os.utime(web / "js/base/c.js", (1, 1))
    after = pages.version()
    assert after != before
    assert pages.get(f"/v/{after}/js/base/c.js").text == "export const c = 2;\n"
    assert pages.get(f"/v/{before}/js/base/c.js").status_code == 404
    old = pages.get(f"/v/{before}/css/a.css")
    assert old.text == "a {}" and old.headers["cache-control"] == "no-store"


@pytest.mark.parametrize("path", ["/js/main.js", "/css/a.css", "/icon.svg"])
def test_files_have_unversioned_urls_too(pages: Pages, path: str) -> None:
    answer = pages.get(path)
    assert answer.status_code == 200 and answer.headers["cache-control"] == "no-cache"


@pytest.mark.parametrize(
    "path",
    [
        "/v",
        "/v/",
        "/v/x",
        "/v/x/js/none.js",
        "/v/x/../../secret",
        "/v/x/%2e%2e/%2e%2e/secret",
        "/v/x/node_modules/x.js",
        "/v/x/.hidden.js",
    ],
)
def test_other_paths_are_404(pages: Pages, path: str) -> None:
    assert pages.get(path).status_code == 404


def test_typeface_is_served_from_package(web: Path) -> None:
    pages = Pages(web)
    answer = pages.get("/fonts/inter.ttf", {"Accept-Encoding": "gzip"})
    assert answer.status_code == 200 and answer.headers["content-type"] == "font/ttf"
    assert answer.headers["content-encoding"] == "gzip" and "max-age=2592000" in answer.headers["cache-control"]
    font = ImageFont.truetype(io.BytesIO(answer.content))
    assert font.getname()[0] == "Inter"
    assert [(axis["minimum"], axis["maximum"]) for axis in font.get_variation_axes()] == [(14, 32), (100, 900)]
    for sheet in (ROOT / "web/css/tokens.css", ROOT / "service/docs_page/docs.css", ROOT / "service/share_page/share.css"):
        assert f'url("/{FONT}")' in sheet.read_text(), sheet


def test_no_typeface_without_package(web: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert Pages(web).get("/fonts/inter.ttf").status_code == 404
