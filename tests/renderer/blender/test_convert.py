"""Tests of conversion by a Blender process: results, and errors when Blender fails. A script replaces Blender."""

from __future__ import annotations

import stat
from collections.abc import Callable
from pathlib import Path

import pytest

from renderer.blender import program
from renderer.blender.convert import convert
from renderer.blender.program import NAMED, BlenderError, find, inspect_blender
from renderer.errors import SceneError
from renderer.scene.animation import Moment
from renderer.scene.load import Shot, read

SCENE = '{"notes": ["Material odd: is left out"], "shapes": [{"type": "quad"}]}'
VERSION = 'if [ "$3" = --version ]; then echo "Blender 4.5.1 LTS"; exit 0; fi\n'
WORKS = f"""for job; do :; done
out=$(sed 's/.*"out": "\\([^"]*\\)".*/\\1/' "$job")
echo '{SCENE}' > "$out/blender-scene.yaml"
echo secret > "$out/other.txt"
echo '{{"main": "blender-scene.yaml"}}' > "$out/report.json"
"""


@pytest.fixture
def blender(tmp_path: Path) -> Callable[[str], str]:
    """Returns a function that takes a script and returns the path of a fake Blender that runs it on opening a file."""

    def make(script: str, version: str = VERSION) -> str:
        path = tmp_path / "program" / "blender"
        path.parent.mkdir(exist_ok=True)
        path.write_text(f"#!/bin/sh\n{version}{script}")
        path.chmod(path.stat().st_mode | stat.S_IXUSR)
        inspect_blender.cache_clear()
        return str(path)

    return make


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    folder = tmp_path / "scene"
    folder.mkdir()
    (folder / "a.blend").write_bytes(b"BLENDER-v405")
    return folder


def test_scene_written_by_blender_is_read(blender, scene, monkeypatch):
    monkeypatch.setenv(NAMED, blender(WORKS))
    found = find()
    assert found is not None
    assert (found.version, found.is_module) == ("4.5.1", False)
    shot = Shot(scene, "a.blend")
    for frame in (0, 3):
        description = shot.scene_at(Moment(frame))
        assert len(description.instances) == 1
        assert description.warnings[0] == "Material odd: is left out"


def test_only_expected_output_files_are_kept(blender, scene, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    assert convert(inspect_blender(blender(WORKS)), scene, "a.blend", out, 1 << 30, 60) == "blender-scene.yaml"
    assert [path.name for path in out.iterdir()] == ["blender-scene.yaml"]


@pytest.mark.parametrize(
    ("script", "says"),
    [
        (
            'for job; do :; done; out=$(sed \'s/.*"out": "\\([^"]*\\)".*/\\1/\' "$job")\n'
            + 'echo \'{"error": "is damaged"}\' > $out/report.json\n',
            "is damaged",
        ),
        ("exit 3", r"ended while it opened the file \(code 3\)"),
        ("kill -SEGV $$", r"ended while it opened the file \(SIGSEGV\)"),
        ("sleep 60", "took longer than 2 seconds"),
    ],
)
def test_failure_reason_is_reported(blender, scene, tmp_path, script, says):
    with pytest.raises(SceneError, match=rf"^a\.blend: .*{says}"):
        convert(inspect_blender(blender(script)), scene, "a.blend", tmp_path, 1 << 30, 2 if "sleep" in script else 60)


def test_missing_blender_error_names_a_remedy(scene, monkeypatch, tmp_path):
    monkeypatch.delenv(NAMED, raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(program, "environment_python", lambda: tmp_path / "none")
    assert find() is None
    with pytest.raises(SceneError, match=r"a\.blend: .*worker --blender.*File > Export > glTF 2\.0"):
        read(scene, "a.blend")


def test_unusable_blender_error_gives_the_reason(blender, tmp_path):
    with pytest.raises(BlenderError, match="There is no Blender at"):
        inspect_blender(str(tmp_path / "gone"))
    with pytest.raises(BlenderError, match=r"is Blender 3\.6\.1; \.blend files need 4\.2"):
        inspect_blender(blender("", VERSION.replace("4.5.1", "3.6.1")))
    with pytest.raises(BlenderError, match="is not Blender"):
        inspect_blender(blender("", "exit 1\n"))
