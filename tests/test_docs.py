"""Tests of the documentation: valid links, every page reachable from the README, and the guide of the page lists its keys."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.helpers import ROOT

CODE = re.compile(r"```.*?```", re.DOTALL)
LINK = re.compile(r"\]\(([^)\s]+)\)")
HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)
# In the page's sources: a key, and what the help shows in its place (null: nothing).
KEY = re.compile(r'(?:\bkeys?: (?:t\()?|\btool\(t\("[^"]*"\), t\("[^"]*"\), )"([^"]+)"\)?(?:, shown: (?:t\()?(null|"[^"]+"))?')
DECLARES_KEYS = re.compile(r"\b(?:keys?|shown):|\b(?:step|tool)\(|KEYS\b")
KEY_ROW = re.compile(r"^\| (`.+?) \|", re.MULTILINE)
PAGES = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "deploy").rglob("*.md")]


def test_documentation_links_are_valid() -> None:
    dead = [f"{page.relative_to(ROOT)}: {link}" for page in PAGES for link in _links(page) if not _is_there(page, link)]
    assert not dead


def test_every_page_is_reachable_from_the_readme() -> None:
    named = {(ROOT / link.partition("#")[0]).resolve() for link in _links(ROOT / "README.md")}
    assert not {page.name for page in (ROOT / "docs").glob("*.md")} - {page.name for page in named}


@pytest.mark.parametrize(
    ("section", "sources"),
    [
        ("A scene", ("views/scene.js", "scene/*.js", "forms/side-views.js")),
        ("A picture", ("views/job.js", "job/*.js")),
        ("Two pictures", ("views/compare.js", "compare/ways.js")),
        ("A shot", ("shot/shot-keys.js",)),
        ("The list of jobs", ("views/jobs.js",)),
        ("Every page", ("main.js", "views/home.js", "shell/palette.js")),
    ],
)
def test_guide_lists_the_keys_of_the_page(section: str, sources: tuple[str, ...]) -> None:
    """Each table of keys has those that the sources of its page declare, and no others."""
    guide = (ROOT / "docs" / "page.md").read_text(encoding="utf-8")
    table = guide.partition(f"\n## {section}\n")[2].partition("| key | |\n")[2].partition("\n\n")[0]
    listed = {key for row in KEY_ROW.findall(table) for key in re.findall("`(.+?)`", row)}
    files = [file for source in sources for file in (ROOT / "web" / "js").glob(source)]
    text = "\n".join(file.read_text(encoding="utf-8") for file in files)
    shown = {shown.strip('"') or key for key, shown in KEY.findall(text)} - {"null"}
    assert listed
    assert not shown - listed, "missing in the guide"
    declared = "\n".join(line for line in text.splitlines() if DECLARES_KEYS.search(line)).replace("`", '"')
    declared = declared.replace("${i + 1}", "1")  # the first of keys that differ in a number
    assert not {key for key in listed if f'"{key}"' not in declared}, "not on the page"


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
