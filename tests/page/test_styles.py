"""Tests that the page's style sheets take type sizes, weights, radii and spacing from one scale."""

from __future__ import annotations

import re

import pytest

from tests.helpers import ROOT

SHEETS = {path.name: path.read_text(encoding="utf-8") for path in sorted((ROOT / "web" / "css").glob("*.css"))}
SIZE = re.compile(r"var\(--text-(12|13|14|16|20|24)\)|inherit")
ROOT_SIZE = re.compile(r"(16|20)px")  # of html in base.css: what the scale's rem refer to
SPACE = r"(?:padding|margin|(?:row-|column-)?gap)(?:-(?:top|right|bottom|left|(?:inline|block)(?:-start|-end)?))?"
LENGTH = re.compile(r"[\d.]+(?:rem|px|em)")
INLINE_CODE = "0.05em 0.4em"  # follows its text's size
RADIUS = re.compile(r"0|50%|inherit|var\(--radius(-small|-large|-pill)?\)")


def _values(sheet: str, name: str) -> list[str]:
    """Returns the values of a property in a style sheet."""
    return re.findall(rf"(?:^|[\s;{{]){name}:\s*([^;}}]+)", SHEETS[sheet])


@pytest.mark.parametrize("sheet", SHEETS)
def test_sizes_weights_and_radii_are_in_scale(sheet: str) -> None:
    sizes = [value for value in _values(sheet, "font-size") if not SIZE.fullmatch(value)]
    if sheet == "base.css":
        sizes = [value for value in sizes if not ROOT_SIZE.fullmatch(value)]
    assert sizes == []
    assert set(_values(sheet, "font-weight")) <= {"400", "500", "600", "400 600", "inherit"}
    radii = [part for value in _values(sheet, r"border(?:-[a-z]+)*-radius") for part in value.split()]
    assert [part for part in radii if not RADIUS.fullmatch(part)] == []


@pytest.mark.parametrize("sheet", sorted(SHEETS.keys() - {"tokens.css"}))
def test_paddings_margins_and_gaps_are_on_the_grid(sheet: str) -> None:
    off = [value for value in _values(sheet, SPACE) if set(LENGTH.findall(value)) - {"1px"}]
    assert [value for value in off if "calc(" not in value] == ([INLINE_CODE] if sheet == "base.css" else [])


@pytest.mark.parametrize("sheet", ["docs_page/docs.css", "share_page/share.css"])
def test_pages_of_the_service_have_the_same_sizes_and_weights(sheet: str) -> None:
    text = (ROOT / "service" / sheet).read_text(encoding="utf-8")
    sizes = {size for size in re.findall(r"font(?:-size)?:[^;}]*?([\d.]+(?:px|rem|em))", text) if size != "0px"}
    assert sizes <= {"12px", "13px", "14px", "16px", "20px", "24px"}
    assert set(re.findall(r"font-weight: ([^;]+)", text)) <= {"400", "500", "600", "400 600"}
    assert re.search(r"(?:^|\n)th \{ font-weight: (?:500|600)", text) or "docs" not in sheet, "700 by default, which Inter lacks"
    assert re.search(r"\nstrong, b \{ font-weight: 600", text) or "docs" not in sheet


def test_scale_has_six_sizes_and_three_radii() -> None:
    tokens = SHEETS["tokens.css"]
    assert re.findall(r"--text-(\d+): ([\d.]+)rem", tokens) == [
        (str(size), f"{size / 16:g}") for size in (12, 13, 14, 16, 20, 24)
    ]
    spaces = re.findall(r"--space-(\d+): ([\d.]+)rem", tokens)
    assert len(spaces) > 10 and all(int(px) % 4 == 0 and float(rem) * 16 == int(px) for px, rem in spaces)
    assert {name for sheet in SHEETS.values() for name in re.findall(r"var\(--space-(\d+)\)", sheet)} == {px for px, _ in spaces}
    assert re.findall(r"--radius(?:-small|-large)?: (\d+)px", tokens) == ["4", "8", "12"]
