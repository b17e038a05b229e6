"""Tests of `rayfarm husk`: UsdRender settings, products and vars, and the time codes of a stage."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdLux, UsdRender

from rayfarm.commands.husk import aov_of, pattern_of
from tests.rayfarm.program import rayfarm
from tests.rayfarm.test_with_farm import pixels
from tests.renderer.scene.usd_files import cube, stage

START = 1001


def channels(path: Path) -> list[str]:
    file = oiio.ImageInput.open(str(path))
    try:
        return list(file.spec().channelnames)
    finally:
        file.close()


def var(made: Usd.Stage, name: str, source: str, kind: str = "raw") -> Sdf.Path:
    found = UsdRender.Var.Define(made, f"/Render/Vars/{name}")
    found.CreateSourceNameAttr(source)
    found.CreateSourceTypeAttr(kind)
    return found.GetPath()


@pytest.fixture
def shot(tmp_path: Path) -> Path:
    """Returns a stage of 24 frames from 1001, in which a cube moves; it has two cameras, settings and a product."""
    made = stage(tmp_path / "shot.usda")
    made.SetStartTimeCode(START)
    made.SetEndTimeCode(START + 23)
    made.SetTimeCodesPerSecond(24)
    made.SetFramesPerSecond(24)
    move = cube(made, "/box").AddTranslateOp()
    for code in (START, START + 23):
        move.Set(Gf.Vec3d(0.05 * (code - START), 0, 0), code)
    UsdLux.DomeLight.Define(made, "/dome")
    for name, far in (("wide", 9.0), ("close", 5.0)):
        camera = UsdGeom.Camera.Define(made, f"/cameras/{name}")
        camera.AddTranslateOp().Set(Gf.Vec3d(0.3, 0.2, far))
    settings = UsdRender.Settings.Define(made, "/Render/main")
    settings.CreateResolutionAttr(Gf.Vec2i(40, 24))
    settings.CreateCameraRel().SetTargets(["/cameras/close"])
    product = UsdRender.Product.Define(made, "/Render/Products/beauty")
    product.CreateProductNameAttr("pictures/shot.$F4.exr")
    product.CreateOrderedVarsRel().SetTargets(
        [
            var(made, "beauty", "C.*[LO]", "lpe"),
            var(made, "z", "depth"),
            var(made, "n", "N"),
            var(made, "odd", "sparkle"),
        ]
    )
    deep = UsdRender.Product.Define(made, "/Render/Products/deep")
    deep.CreateProductTypeAttr("deepRaster")
    settings.CreateProductsRel().SetTargets([deep.GetPath(), product.GetPath()])
    other = UsdRender.Settings.Define(made, "/Render/other")
    other.CreateResolutionAttr(Gf.Vec2i(16, 16))
    made.SetMetadata("renderSettingsPrimPath", "/Render/main")
    made.GetRootLayer().Save()
    return tmp_path / "shot.usda"


def test_the_settings_product_is_rendered_with_its_vars(shot: Path, tmp_path: Path) -> None:
    done = rayfarm("husk", shot, "--frame", START + 4, "-n", "2", "-i", "8", "-p", "4", "--make-output-path", COLUMNS="300")
    assert done.returncode == 0, done.stderr
    assert "The render var /Render/Vars/odd (sparkle) is left out" in done.stderr
    assert "The deep render product /Render/Products/deep is written beside the picture" in done.stderr
    files = [f"shot.{code}{suffix}" for code in (1005, 1013) for suffix in (".deep.exr", ".exr")]
    assert sorted(path.name for path in (tmp_path / "pictures").iterdir()) == files
    assert channels(tmp_path / "pictures" / files[0]) == ["R", "G", "B", "A", "Z", "ZBack"]
    names = channels(tmp_path / "pictures" / "shot.1005.exr")
    assert {"R", "Depth.Z", "Normal.X"} <= set(names) and not [name for name in names if "Albedo" in name]
    asked = ["--size=40x24", "--spp=4", "--camera=close", "--frames=4,12", "-o", tmp_path / "plain.##.exr"]
    assert rayfarm("render", shot, *asked).returncode == 0
    for code, frame in ((1005, "04"), (1013, "12")):
        ours, plain = pixels(tmp_path / f"pictures/shot.{code}.exr"), pixels(tmp_path / f"plain.{frame}.exr")
        assert ours.shape == (24, 40, 3)
        assert np.array_equal(ours, plain)
    assert not np.array_equal(pixels(tmp_path / "plain.04.exr"), pixels(tmp_path / "plain.12.exr")), "the cube moves"


@pytest.mark.long
def test_options_replace_what_the_settings_say(shot: Path, tmp_path: Path) -> None:
    words = ["-o", tmp_path / "a.<F3>.png", "-c", "/cameras/wide", "-r", "64", "32", "--res-scale", "50", "-p", "2"]
    done = rayfarm("husk", shot, *words, COLUMNS="300")
    assert done.returncode == 0, done.stderr
    assert ".png has no room for further channels" in done.stderr
    assert pixels(tmp_path / "a.1001.png").shape == (16, 32, 3)
    done = rayfarm("husk", shot, "-s", "/Render/other", "-o", tmp_path / "b.exr", "-p", "2", "--res-scale", "200")
    assert done.returncode == 0, done.stderr
    assert pixels(tmp_path / "b.exr").shape == (32, 32, 3)


def refusals(*cases: tuple[list[str | Path], str]) -> None:
    for words, said in cases:
        done = rayfarm("husk", *words, COLUMNS="300")
        assert done.returncode == 1, (words, done.stderr)
        assert said in done.stderr.splitlines()[-1], done.stderr


def test_what_is_not_in_the_stage_or_not_known_is_refused(shot: Path, tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("v 0 0 0\n")
    refusals(
        ([shot, "--slap-comp", "x"], "--slap-comp is not an option of husk that Rayfarm has"),
        (["--slap-comp", "x", shot], "--slap-comp is not an option of husk that Rayfarm has"),
        ([shot, "-R", "BRAY_HdKarma"], "-R is not an option"),
        ([tmp_path / "a.obj"], "a.obj is not a USD file"),
        ([shot, "-s", "/nowhere"], "its render settings are /Render/main, /Render/other"),
        ([shot, "-f", "1000", "-o", "x.exr"], "begins at 1001"),
    )


@pytest.mark.long
def test_further_requests_that_give_no_picture_are_refused(shot: Path) -> None:
    refusals(
        ([shot, "-n", "3", "-o", "x.exr"], "is one file for 3 frames"),
        ([shot, "-s", "/Render/other"], "no render product with a name"),
        ([shot, "-c", "/cameras/none", "-o", "x.exr"], "none"),
        ([shot, "-n", "2"], "There is no folder"),
    )


@pytest.mark.parametrize(
    ("written", "pattern"),
    [
        ("a.$F4.exr", "a.####.exr"),
        ("a.$F.exr", "a.#.exr"),
        ("<F3>.exr", "###.exr"),
        ("a%04d.exr", "a####.exr"),
        ("a.##.png", "a.##.png"),
    ],
)
def test_a_frames_number_is_written_in_husks_ways(written: str, pattern: str) -> None:
    assert pattern_of(written) == pattern
    assert not re.search(r"[$<%]", pattern_of(written))


def test_render_vars_are_known_by_their_sources() -> None:
    known = {"C.*[LO]": "lpe", "Ci": "raw", "N": "raw", "Pz": "raw", "P": "raw", "albedo": "raw", "sampleCount": "raw"}
    assert [aov_of(source, kind) for source, kind in known.items()] == [
        *("color", "color", "normal", "depth", "position", "albedo", "samples"),
    ]
    assert aov_of("C<RD>.*[LO]", "lpe") is None  # direct and indirect light in one
    paths = {"C<RD>[<L.>O]": "diffuse_direct", "lpe:C<RD>.+L": "diffuse_indirect", "C<R[GS]>.+[LO]": "glossy_indirect"}
    assert [aov_of(source, "lpe") for source in paths] == [f"path:{name}" for name in paths.values()]
    assert aov_of("directdiffuse", "raw") == "path:diffuse_direct"
    assert aov_of("st", "primvar") is None
