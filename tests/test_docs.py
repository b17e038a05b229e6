"""Tests of the documentation's links: to existing files, headings and pictures; each page is reachable from the README."""

from __future__ import annotations

import re
from pathlib import Path

from tests.helpers import ROOT

CODE = re.compile(r"```.*?```", re.DOTALL)
LINK = re.compile(r"\]\(([^)\s]+)\)")
HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)
PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "deploy").rglob("*.md")]


def test_documentation_links_are_valid() -> None:
    dead = [f"{page.relative_to(ROOT)}: {link}" for page in PAGES for link in _links(page) if not _is_there(page, link)]
    assert not dead


def test_every_page_is_reachable_from_the_readme() -> None:
    named = {(ROOT / link.partition("#")[0]).resolve() for link in _links(ROOT / "README.md")}
    assert not {page.name for page in (ROOT / "docs").glob("*.md")} - {page.name for page in named}


def _links(page: Path) -> list[str]:
    return [link for link in LINK.findall(CODE.sub("", page.read_text(encoding="utf-8"))) if ":" not in link]


def _is_there(page: Path, link: str) -> bool:
    name, _, part = link.partition("#")
    target = (page.parent / name).resolve() if name else page
    return target.exists() and (not part or target.suffix != ".md" or part in _anchors(target))


def _anchors(page: Path) -> set[str]:
    """Returns the anchors that GitHub derives from a page's headings."""
    headings = HEADING.findall(CODE.sub("", page.read_text(encoding="utf-8")))
    return {re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-") for heading in headings}
