"""Tests of `rayfarm compare` with a Mitsuba file, rendered by both renderers."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from PIL import Image

from tests.peers.test_mitsuba_files import SHAPES, write_files
from tests.rayfarm.program import rayfarm
from tests.renderer.scene.pbrt_files import world


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("compared")
    write_files(made)
    text = SHAPES["files of meshes, textures, instances, lights without a body"]
    (made / "scene.xml").write_text(text)
    return made


@pytest.mark.long
def test_comparison_prints_differences(folder: Path) -> None:
    pytest.importorskip("mitsuba")
    done = rayfarm("compare", folder / "scene.xml", "--spp=16", "-o", folder / "both.png", "--most=0.03")
    assert done.returncode == 0, done.stderr
    mean = float(done.stdout.split("of Mitsuba: ")[1].split("%")[0])
    assert abs(mean) < 3
    assert "relMSE" in done.stdout
    with Image.open(folder / "both.png") as both:
        assert both.size == (3 * 48, 32)
    assert rayfarm("compare", folder / "scene.xml", "--spp=1", "--most=0").returncode == 1


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["scene.glb"], "is not a Mitsuba or pbrt scene"),
        (["scene.pbrt"], "There is no program pbrt on the PATH"),
        (["scene.xml", "-o", "both.exr"], "the output is a .png file"),
        (["nowhere.xml"], "There is no file"),
    ],
)
def test_errors_are_reported(arguments: list[str], sentence: str, folder: Path) -> None:
    done = rayfarm("compare", *(str(folder / each) if each[0] != "-" else each for each in arguments))
    assert done.returncode == 1
    assert sentence in " ".join(done.stderr.split())


@pytest.mark.long
def test_comparison_with_pbrt(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A script in place of pbrt receives pbrt's arguments, and its picture is compared."""
    (folder / "scene.pbrt").write_text(world('LightSource "infinite" Shape "sphere"'))
    ours = tmp_path / "ours.exr"
    assert rayfarm("render", folder / "scene.pbrt", "-o", ours, "--spp=16").returncode == 0
    program = tmp_path / "pbrt"
    program.write_text(f'#!/bin/sh\n[ "$1 $2 $3 $4 $6" = "--quiet --spp 16 --outfile scene.pbrt" ] && cp {ours} "$5"\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    done = rayfarm("compare", folder / "scene.pbrt", "--spp=16", "--most=0.001")
    assert done.returncode == 0, done.stderr
    assert "of pbrt: " in done.stdout
