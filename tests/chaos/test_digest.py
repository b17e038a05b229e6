"""The digest of a finished frame depends on the request alone: not on tiles, slots, or what was killed on the way."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

from renderer.film import digest
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.load import read
from renderer.settings import RenderSettings, View
from tests.helpers import ROOT, Farm, start_farm, stop_farm, wait_until

pytestmark = pytest.mark.farm

WIDTH, HEIGHT, SPP, DEPTH = 96, 80, 320, 5
VIEW = View((0, 0, 3.9), (0, 0, 0), (0, 1, 0), 39.3077)


@pytest.fixture(scope="module")
def chaos_farm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Farm]:
    """A farm whose parts are killed; impatient, so that what is lost is soon handed out again."""
    farm = start_farm(tmp_path_factory.mktemp("chaos") / "data", 2, RAYFARM_BATCH_DEADLINE="5")
    yield farm
    stop_farm(farm)


def alone(spp: int) -> str:
    """The digest of the same frame, rendered in this process without a farm."""
    scene = compile_scene(read(ROOT / "scenes", "cornell-box.yaml"))
    settings = RenderSettings(WIDTH, HEIGHT, VIEW, max_depth=DEPTH)
    return digest(render_frame(scene, settings, spp, threads=2))


@pytest.fixture(scope="module")
def expected() -> str:
    return alone(SPP)


@pytest.fixture(scope="module")
def soon() -> str:
    """Of a fifth of the samples: for what nobody disturbs."""
    return alone(SPP // 5)


def submit(farm: Farm, spp: int = SPP, **more: Any) -> str:
    with farm.client() as client:
        scene = client.wait_for_scene(client.upload([ROOT / "scenes" / "cornell-box.yaml"]).id)
        view = {"eye": VIEW.eye, "target": VIEW.target, "up": VIEW.up, "fov": VIEW.fov}
        job = client.submit(scene.id, view=view, width=WIDTH, height=HEIGHT, spp=spp, max_depth=DEPTH, **more)
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


@pytest.mark.parametrize("tile_size", [16, 64])
def test_the_size_of_tiles_does_not_matter(chaos_farm: Farm, soon: str, tile_size: int) -> None:
    assert finish(chaos_farm, submit(chaos_farm, SPP // 5, tile_size=tile_size)) == soon


@pytest.mark.long  # the film that it is held against is made without a farm, as that of two slots above
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
        pytest.param(kill_a_slot, id="a slot"),
        pytest.param(kill_part("worker"), id="the worker"),
        pytest.param(kill_part("service"), id="the service"),
        pytest.param(kill_part("redis"), id="Redis"),
    ],
)
def test_what_is_killed_half_way_does_not_matter(chaos_farm: Farm, expected: str, kill: Callable[[Farm], None]) -> None:
    job = submit(chaos_farm)
    half_way(chaos_farm, job)
    kill(chaos_farm)
    assert finish(chaos_farm, job) == expected
