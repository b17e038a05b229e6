"""Tests of the table of outcomes that `bench files` prints."""

from pathlib import Path

import pytest

from renderer.errors import SceneError
from tests.benchmarks import bench_files
from tests.benchmarks.bench_files import Found, read_one, scene_files, table
from tests.renderer.scene.builders import Gltf, cup


def test_files_are_counted_by_outcome(tmp_path):
    bad = Gltf()
    bad.mesh()
    bad.mesh()
    bad.root["accessors"][1]["count"] = 0
    for name, data in (("a.glb", cup()), ("b.glb", bad.glb()), ("c.glb", b"glTF"), ("d.txt", b"")):
        (tmp_path / name).write_bytes(data)
    files = scene_files([tmp_path])
    assert [path.name for path in files] == ["a.glb", "b.glb", "c.glb"]
    found = [read_one(path) for path in files]
    assert [each.end for each in found] == ["loads", "warnings", "refused"], found
    assert table(found).splitlines()[2].startswith("| .glb | 3 | 2 | 1 | 1 | 0 | 0 | 0 |")


def test_crash_is_counted_as_an_outcome():
    rows = table([Found(Path("a.iqm"), "crashed", 1.0, "its importer crashed")]).splitlines()
    assert rows[-1].startswith("| all | 1 | 0 | 0 | 0 | 1 | 0 | 0 | 1.00 | 1.0 |")


@pytest.mark.parametrize("error", [ValueError("odd"), SceneError("a.obj cannot be read (ValueError: odd).")])
def test_unexpected_exceptions_count_as_failures(monkeypatch, error):
    def fail(_):
        raise error

    monkeypatch.setattr(bench_files, "describe", fail)
    assert read_one(Path("a.obj")).end == "failed"
