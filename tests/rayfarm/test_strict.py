"""Tests of the options --strict and --root of the command line."""

from pathlib import Path

import pytest

from rayfarm.errors import CommandError
from rayfarm.scene_files import files_to_upload, opened_scene, relative_to_root
from rayfarm.strict import refuse_warnings
from tests.rayfarm.program import rayfarm
from tests.service.conftest import OBJ, Service


def test_strict_lists_all_warnings():
    refuse_warnings("a.glb", [], True)
    refuse_warnings("a.glb", ["One.", "Two."], False)
    with pytest.raises(CommandError) as caught:
        refuse_warnings("a.glb", ["One.", "Two."], True)
    assert str(caught.value) == "a.glb: 2 warnings, and --strict makes them errors:\n  One.\n  Two."


def test_files_below_root_belong_to_scene(tmp_path):
    inner = tmp_path / "scenes"
    inner.mkdir()
    (tmp_path / "x.usda").write_text('#usda 1.0\ndef Cube "m" {}\n')
    scene = inner / "a.usda"
    scene.write_text('#usda 1.0\ndef "a" (references = @../x.usda@</m>) {}\n')
    assert set(files_to_upload(scene)) == {"a.usda"}
    assert set(files_to_upload(scene, tmp_path)) == {"scenes/a.usda", "x.usda"}
    with opened_scene(scene, root=tmp_path) as (folder, main, _):
        assert (folder, main) == (tmp_path, "scenes/a.usda")
    with pytest.raises(CommandError, match="not a folder above"):
        relative_to_root(tmp_path / "x.usda", inner)


def test_strict_submit_lists_warnings_and_creates_no_job(service: Service, tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_bytes(OBJ + b"# guessed\n")
    with service.worker():
        done = rayfarm("submit", tmp_path / "a.obj", "--server", service.url, "--strict", COLUMNS="200")
        assert done.returncode == 1
        assert (
            "2 warnings, and --strict makes them errors:\n  2 materials were guessed.\n  The file x.png is missing."
            in done.stderr
        )
        assert service.http.get("/api/jobs").json() == []
        done = rayfarm("submit", tmp_path / "a.obj", "--server", service.url, "--size=16x16", "--spp=1", COLUMNS="200")
        assert (done.returncode, done.stderr.count("note: ")) == (0, 2)
