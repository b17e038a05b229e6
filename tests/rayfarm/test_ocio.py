"""Tests of OpenColorIO on the command line: the list of views, where the config comes from, and refused options."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.helpers import ROOT
from tests.rayfarm.program import rayfarm

CORNELL = ROOT / "scenes" / "cornell-box.yaml"
PQ_VIEW = "ocio:Rec.2100-PQ - Display/ACES 2.0 - HDR 1000 nits (Rec.2020)"


def test_views_are_listed_by_the_names_of_tonemap() -> None:
    listed = rayfarm("ocio").stdout
    assert "  ocio:ACES 2.0 - SDR 100 nits (Rec.709), or ocio\n" in listed
    assert f"  {PQ_VIEW}\n" in listed
    found = json.loads(rayfarm("ocio", "--ocio", "studio", "--json").stdout)
    assert [view["default"] for view in found["views"]].count(True) == 1
    assert len(found["views"]) > 40


def test_config_is_that_of_the_option_then_of_the_environment(tmp_path: Path) -> None:
    environment = {"RAYFARM_OCIO": "studio", "OCIO": str(tmp_path / "none.ocio")}
    assert "studio-config" in rayfarm("ocio", **environment).stdout
    assert "cg-config" in rayfarm("ocio", "--ocio", "cg", **environment).stdout
    refused = rayfarm("ocio", OCIO=environment["OCIO"])
    assert refused.returncode == 1
    assert "none.ocio' cannot be read" in refused.stderr


@pytest.mark.parametrize(
    ("output", "options", "sentence"),
    [
        ("a.png", ["--tonemap", "ocio:nothing"], "'ocio:nothing' is no view of the OCIO config 'cg'"),
        ("a.png", ["--tonemap", "nothing"], "tone curve is 'nothing'"),
        ("a.png", ["--gain-map"], "--gain-map is for .jpg"),
        ("a.jpg", ["--gain-map", "--tonemap", PQ_VIEW], "a gain map is for pictures of standard range"),
        ("a.avif", ["--size", "96x63"], "an .avif has at least 64 x 64 pixels; the picture has 96 x 63"),
        ("a.avif", ["--tonemap", "ocio", "--size", "64x64"], "take an OCIO view of a Rec.2100-PQ display"),
    ],
)
def test_options_that_do_not_fit_are_refused_before_rendering(
    output: str, options: list[str], sentence: str, tmp_path: Path
) -> None:
    done = rayfarm("render", CORNELL, "-o", tmp_path / output, *options)
    assert done.returncode == 1
    assert sentence in done.stderr
    assert list(tmp_path.iterdir()) == []
