"""Tests of a worker with Blender: its report, its tasks, and the result for a .blend. A script replaces Blender."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from protocol.blends import blender_queue
from protocol.contract import Manifest, prepare_queue
from renderer.blender.program import NAMED, inspect_blender
from worker import __main__ as command
from worker.exchange.errors import RefusedError, WorkError
from worker.process.context import WorkerContext
from worker.work import prepare
from worker.work.prepare import CONVERTED_FOLDER


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Returns the path of a script that prints Blender's version, and writes a scene with a picture."""
    path = tmp_path / "bin" / "blender"
    path.parent.mkdir()
    path.write_text(
        '#!/bin/sh\nif [ "$3" = --version ]; then echo "Blender 4.5.1"; exit 0; fi\n'
        'for job; do :; done\nout=$(sed \'s/.*"out": "\\([^"]*\\)".*/\\1/\' "$job")\n'
        'for name in blender-scene.yaml blender-world.exr report.json; do echo "{}" > "$out/$name"; done\n'
    )
    path.chmod(0o755)
    inspect_blender.cache_clear()
    monkeypatch.setenv(NAMED, str(path))
    return str(path)


@pytest.fixture
def options(monkeypatch: pytest.MonkeyPatch) -> Callable[..., argparse.Namespace]:
    """Returns a function that parses the given command-line arguments of `rayfarm worker`."""

    def make(*words: str) -> argparse.Namespace:
        monkeypatch.setattr("sys.argv", ["worker", "--service", "http://farm.invalid", *words])
        return command._options()

    return make


def test_worker_with_blender_reports_it_and_serves_blender_queue(
    program: str, options: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert command._check_settings(options()) is None
    monkeypatch.delenv(NAMED)
    found = command._check_settings(options("--blender", program))
    assert found is not None
    assert found.version == "4.5.1"
    assert "blender" in command._tags(options("--blender", program), "host", "kind")
    assert "blender" not in command._tags(options(), "host", "kind")
    link: Any = None
    queues = WorkerContext("w", 1, "kind", "", link, link, link, blender=found).queues
    assert blender_queue("kind") in queues
    assert prepare_queue("kind") in queues
    assert blender_queue("kind") not in WorkerContext("w", 1, "kind", "", link, link, link).queues
    with pytest.raises(RefusedError, match="give --blender"):
        command._check_settings(options("--tag", "blender"))
    with pytest.raises(RefusedError, match="There is no Blender at"):
        command._check_settings(options("--blender=/no/blender"))


def test_environment_image_is_placed_beside_blender_files(program: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder, written = tmp_path / "scene", tmp_path / CONVERTED_FOLDER
    room: Any = SimpleNamespace(folder=tmp_path, scene=folder)
    (folder / "sky").mkdir(parents=True)
    (folder / "a.blend").write_bytes(b"BLENDER-v405")
    (folder / "sky" / "noon.exr").write_bytes(b"light")
    opened = prepare._convert_with_blender(Manifest("s", "a.blend", [], "sky/noon.exr"), room)
    assert opened == ["blender-scene.yaml", "blender-world.exr"]
    assert (written / "sky" / "noon.exr").read_bytes() == b"light"
    monkeypatch.delenv(NAMED)
    monkeypatch.setattr(prepare, "find", lambda: None)
    (tmp_path / "again").mkdir()
    room.folder = tmp_path / "again"
    with pytest.raises(WorkError, match=r"a\.blend: this worker has no Blender any more"):
        prepare._convert_with_blender(Manifest("s", "a.blend", []), room)
