"""Tests of a .blend in a real farm with a real Blender that is killed while it opens the file, or whose job is cancelled."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.helpers import ROOT, Farm, farm_of, stop_farm, wait_until
from tests.peers.blender import python_with_bpy

pytestmark = [pytest.mark.long, pytest.mark.timeout(900)]

MAKE = """
import sys, bpy
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.mesh.primitive_cube_add(size=float(sys.argv[2]))
ball = bpy.context.object.modifiers.new("ball", "SUBSURF")
ball.levels = ball.render_levels = int(sys.argv[3])
bpy.ops.object.light_add(type="SUN")
bpy.ops.object.camera_add(location=(0, 0, 6))
bpy.context.scene.camera = bpy.context.object
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
"""
SLOW, QUICK = 9, 1  # subdivision levels of a cube: 1.5 million faces, or a few
SIZE: dict[str, Any] = {"width": 32, "height": 32, "spp": 2}


@pytest.fixture
def blender_farm(tmp_path: Path) -> Iterator[Farm]:
    python = python_with_bpy()
    if python is None:
        pytest.skip("no Python with bpy is here; `python3 farm.py peers` makes one")
    with tempfile.TemporaryDirectory(prefix="rf-") as temporary:
        (tmp_path / "temporary").symlink_to(temporary)
        data = tmp_path / "data"
        up = [sys.executable, "-m", "rayfarm", "up", "--port=0", "--workers=1", f"--data={data}", "--no-browser"]
        up += ["--blender", f"--blender-program={python}"]
        farm = farm_of(up, data, ROOT, TMPDIR=temporary)
        try:
            yield farm
        finally:
            stop_farm(farm)


def made(folder: Path, name: str, size: float, levels: int) -> Path:
    path = folder / name
    subprocess.run([str(python_with_bpy()), "-c", MAKE, str(path), str(size), str(levels)], check=True, capture_output=True)
    return path


def blenders(farm: Farm) -> list[psutil.Process]:
    """Returns the Blender processes that are opening a file."""
    found = []
    for process in psutil.Process(farm.process.pid).children(recursive=True):
        with contextlib.suppress(psutil.Error):
            if any("rayfarm-blender-" in word for word in process.cmdline()):
                found.append(process)
    return found


def left_over(tmp_path: Path) -> list[str]:
    return [path.name for path in (tmp_path / "temporary").glob("rayfarm-blender-*")]


def test_blender_is_killed_or_not_needed_any_more_and_the_worker_goes_on(blender_farm: Farm, tmp_path: Path) -> None:
    farm = blender_farm
    with farm.client() as client:
        slow, other = made(tmp_path, "slow.blend", 2.0, SLOW), made(tmp_path, "other.blend", 2.5, SLOW)
        quick = made(tmp_path, "quick.blend", 2.0, QUICK)

        killed = client.upload([slow]).id
        waits = client.submit(killed, **SIZE).id
        wait_until(lambda: bool(blenders(farm)), 120, "Blender opens the file")
        for process in blenders(farm):
            with contextlib.suppress(psutil.Error):
                process.kill()
        failed = client.wait(waits, timeout_s=120)
        assert failed.state == "failed", failed
        assert "slow.blend" in (failed.error or ""), failed.error
        wait_until(lambda: not left_over(tmp_path), 30, "its folder is gone")

        cancelled = client.submit(client.upload([other]).id, **SIZE).id
        wait_until(lambda: bool(blenders(farm)), 120, "Blender opens the other")
        client.change(cancelled, state="cancelled")
        assert client.job(cancelled).state == "cancelled"

        good = client.submit(client.wait_for_scene(client.upload([quick]).id, 300).id, **SIZE).id
        assert client.wait(good, timeout_s=240).state == "finished"
        again = client.submit(client.wait_for_scene(client.upload([slow]).id, 300).id, **SIZE).id
        assert client.wait(again, timeout_s=240).state == "finished", "another upload tries again"
        assert client.job(cancelled).state == "cancelled"
        wait_until(lambda: not left_over(tmp_path) and not blenders(farm), 120, "nothing is left")
