"""Tests that the page's style sheets take type sizes, weights and radii from one scale."""

from __future__ import annotations

import re

import pytest

from tests.helpers import ROOT

SHEETS = {path.name: path.read_text(encoding="utf-8") for path in sorted((ROOT / "web" / "css").glob("*.css"))}
SIZE = re.compile(r"var\(--text-(12|13|14|16|20|24)\)|inherit")
ROOT_SIZE = re.compile(r"(16|20)px")  # of html in base.css: what the scale's rem refer to
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


def test_scale_has_six_sizes_and_three_radii() -> None:
    tokens = SHEETS["tokens.css"]
    assert re.findall(r"--text-(\d+): ([\d.]+)rem", tokens) == [
        (str(size), f"{size / 16:g}") for size in (12, 13, 14, 16, 20, 24)
    ]
    assert re.findall(r"--radius(?:-small|-large)?: (\d+)px", tokens) == ["4", "8", "12"]
