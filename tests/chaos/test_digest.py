"""Tests that a finished frame's digest depends only on the request: not on tiles, slots, or killed processes."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import pytest

from rayfarm.stage import OpenScene
from renderer.film import digest
from renderer.render import render_frame
from renderer.scene.animation import Moment
from renderer.scene.compile import compile_scene
from renderer.scene.load import Shot, read
from renderer.settings import RenderSettings, View
from tests.chaos.ending import ends_by
from tests.helpers import ROOT, Farm, start_farm, stop_farm, wait_until
from tests.rayfarm.test_sequence import animated_scene

WIDTH, HEIGHT, SPP, DEPTH = 80, 64, 256, 5
VIEW = View((0, 0, 3.9), (0, 0, 0), (0, 1, 0), 39.3077)


def digest_without_farm(spp: int, **more: Any) -> str:
    """Renders the test's frame in this process, without a farm, and returns its digest. more: further settings."""
    scene = compile_scene(read(ROOT / "scenes", "cornell-box.yaml"))
    settings = RenderSettings(WIDTH, HEIGHT, VIEW, max_depth=DEPTH, **more)
    return digest(render_frame(scene, settings, spp, threads=2))


@pytest.fixture(scope="module")
def expected() -> str:
    return digest_without_farm(SPP)


@pytest.fixture(scope="module")
def soon() -> str:
    """Returns the expected digest of the frame with a fifth of the samples, for tests that kill no process."""
    return digest_without_farm(SPP // 5)


def upload(farm: Farm) -> str:
    """Returns the id of the Cornell box, ready."""
    with farm.client() as client:
        return client.wait_for_scene(client.upload([ROOT / "scenes" / "cornell-box.yaml"]).id, timeout_s=240).id


def submit(farm: Farm, spp: int = SPP, **more: Any) -> str:
    scene = upload(farm)
    with farm.client() as client:
        view = {"eye": VIEW.eye, "target": VIEW.target, "up": VIEW.up, "fov": VIEW.fov}
        job = client.submit(scene, view=view, width=WIDTH, height=HEIGHT, spp=spp, max_depth=DEPTH, **more)
        return str(job.id)


def finish(farm: Farm, job: str) -> str:
    with farm.client() as client:
        final = client.wait(job, timeout_s=120)
        assert final.state == "finished", f"{final}\n{farm.logs()}"
        return client.digest(job)


def half_way(farm: Farm, job: str) -> None:
    with farm.client() as client:
        wait_until(lambda: client.job(job).progress > 0.2, 60, "the job is well under way")
        assert client.job(job).progress < 0.9, "the job was too quick to be disturbed"


@pytest.mark.long
@pytest.mark.parametrize("tile_size", [16, 64])
def test_the_size_of_tiles_does_not_matter(farm: Farm, soon: str, tile_size: int) -> None:
    assert finish(farm, submit(farm, SPP // 5, tile_size=tile_size)) == soon


@pytest.mark.long  # the reference film is rendered without a farm, like that of two slots above
def test_one_slot_gives_what_two_give(tmp_path: Path, soon: str) -> None:
    farm = start_farm(tmp_path / "data", 1)
    try:
        assert finish(farm, submit(farm, SPP // 5)) == soon
    finally:
        stop_farm(farm)


def kill_a_slot(farm: Farm) -> None:
    slots = psutil.Process(farm.pids()["worker"]).children()
    max(slots, key=lambda slot: sum(slot.cpu_times()[:2])).kill()


def kill_part(name: str) -> Callable[[Farm], None]:
    def kill(farm: Farm) -> None:
        pid = farm.pids()[name]
        psutil.Process(pid).kill()
        wait_until(lambda: farm.pids()[name] != pid, 20, f"{name} is started again")

    return kill


@pytest.mark.parametrize(
    "kill",
    [
        pytest.param(kill_a_slot, id="a slot", marks=pytest.mark.long),
        pytest.param(kill_part("worker"), id="the worker"),
        pytest.param(kill_part("service"), id="the service", marks=pytest.mark.long),
        pytest.param(kill_part("redis"), id="Redis", marks=pytest.mark.long),
    ],
)
def test_what_is_killed_half_way_does_not_matter(farm: Farm, expected: str, kill: Callable[[Farm], None]) -> None:
    job = submit(farm)
    half_way(farm, job)
    kill(farm)
    assert finish(farm, job) == expected


FRAMES = range(0, 24, 3)
SHOT = {"width": 96, "height": 64, "spp": 192, "environment": {"color": [1.0, 1.0, 1.0]}}
FEW = 48  # samples per pixel in tests without disturbances


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns the path of a GLB file whose triangle moves, so that the compiled scene differs between frames."""
    path = tmp_path_factory.mktemp("shot") / "shot.glb"
    path.write_bytes(animated_scene().glb())
    return path


def stills_of(shot: Path, spp: int) -> dict[float, str]:
    """Renders each of FRAMES in this process as a still; returns the digests by frame number, which must all differ."""
    found: dict[float, str] = {}
    for frame in FRAMES:
        compiled, summary = OpenScene(Shot(shot.parent, shot.name)).scene_at(Moment(frame))
        view = View.from_json(summary["cameras"][0]["view"])
        settings = RenderSettings(SHOT["width"], SHOT["height"], view, environment=(1.0, 1.0, 1.0))
        found[frame] = digest(render_frame(compiled, settings, spp, threads=2))
    assert len(set(found.values())) == len(found)
    return found


@pytest.fixture(scope="module")
def stills(shot: Path) -> dict[float, str]:
    return stills_of(shot, SHOT["spp"])


@pytest.fixture(scope="module")
def few(shot: Path) -> dict[float, str]:
    return stills_of(shot, FEW)


def shoot(farm: Farm, shot: Path, frames: str = "0-21x3", **more: Any) -> str:
    with farm.client() as client:
        scene = client.wait_for_scene(client.upload([shot]).id)
        return str(client.submit(scene.id, frames=frames, **{**SHOT, **more}).id)


def finished_frames(farm: Farm, *jobs: str) -> dict[float, str]:
    with farm.client() as client:
        found = {}
        for job in jobs:
            final = client.wait(job, timeout_s=120)
            assert final.state == "finished", f"{final}\n{farm.logs()}"
            found |= {frame.number: client.digest(job, frame.number) for frame in client.frames(job)}
        return found


@pytest.mark.long
@pytest.mark.parametrize(
    "order", ["breadth-first", *(pytest.param(order, marks=pytest.mark.long) for order in ("in-turn", "centre-out"))]
)
def test_the_order_of_frames_does_not_matter(farm: Farm, shot: Path, few: dict[float, str], order: str) -> None:
    assert finished_frames(farm, shoot(farm, shot, order=order, spp=FEW)) == few


@pytest.mark.long
def test_a_shot_in_two_jobs_at_a_time_is_the_shot_in_one(farm: Farm, shot: Path, few: dict[float, str]) -> None:
    jobs = [shoot(farm, shot, frames, spp=FEW) for frames in ("0-21x6", "3-21x6")]
    assert finished_frames(farm, *jobs) == few


@pytest.mark.long
@pytest.mark.parametrize("kill", [pytest.param(kill_a_slot, id="a slot"), pytest.param(kill_part("service"), id="the service")])
def test_what_is_killed_in_a_shot_does_not_matter(
    farm: Farm, shot: Path, stills: dict[float, str], kill: Callable[[Farm], None]
) -> None:
    job = shoot(farm, shot, order="breadth-first")
    half_way(farm, job)
    kill(farm)
    assert finished_frames(farm, job) == stills


@pytest.mark.long
def test_where_noise_is_evened_out_the_digests_depend_on_the_request_alone(farm: Farm, shot: Path) -> None:
    request = {"order": "noisiest-first", "frames": "0-9x3"}
    quiet = finished_frames(farm, shoot(farm, shot, **request))
    job = shoot(farm, shot, **request)
    half_way(farm, job)
    kill_part("service")(farm)
    assert finished_frames(farm, job) == quiet


def test_ctrl_c_leaves_nothing_of_it(farm: Farm) -> None:
    """Ctrl-C ends the farm and all its processes. Runs last, since all tests of this module share the farm."""
    ends_by(farm, [signal.SIGINT], 10, 2)
