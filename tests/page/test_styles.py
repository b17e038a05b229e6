"""Tests that the page's style sheets take type sizes, weights, radii and spacing from one scale."""

from __future__ import annotations

import re

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


def test_sizes_weights_and_radii_are_in_scale() -> None:
    for sheet in SHEETS:
        sizes = [value for value in _values(sheet, "font-size") if not SIZE.fullmatch(value)]
        if sheet == "base.css":
            sizes = [value for value in sizes if not ROOT_SIZE.fullmatch(value)]
        assert sizes == [], sheet
        assert set(_values(sheet, "font-weight")) <= {"400", "500", "600", "400 600", "inherit"}, sheet
        radii = [part for value in _values(sheet, r"border(?:-[a-z]+)*-radius") for part in value.split()]
        assert [part for part in radii if not RADIUS.fullmatch(part)] == [], sheet


def test_paddings_margins_and_gaps_are_on_the_grid() -> None:
    for sheet in SHEETS.keys() - {"tokens.css"}:
        off = [value for value in _values(sheet, SPACE) if set(LENGTH.findall(value)) - {"1px"}]
        assert [value for value in off if "calc(" not in value] == ([INLINE_CODE] if sheet == "base.css" else []), sheet


def test_every_step_of_spacing_is_defined_and_used() -> None:
    defined = re.findall(r"--space-(\d+):", SHEETS["tokens.css"])
    assert {name for sheet in SHEETS.values() for name in re.findall(r"var\(--space-(\d+)\)", sheet)} == set(defined)


def test_bold_elements_have_a_weight_of_the_scale() -> None:
    """The browser's own weight of these elements is 700, for which the page has no font."""
    assert re.search(r"\nb,\nstrong,\nth \{\s*font-weight: 600;", SHEETS["base.css"])
