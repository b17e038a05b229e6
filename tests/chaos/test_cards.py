"""Tests of a farm with two workers, one on a graphics card and one on CPU slots: a job has the same digest in all cases.

The graphics card or its worker may fail meanwhile. The card is simulated on the CPU by the driver of tests/renderer/cuda.
"""

from __future__ import annotations

import io
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import psutil
import pytest
from PIL import Image
from websockets.sync.client import connect

from renderer import film
from renderer.child_processes import spawn_guard
from renderer.cuda import verdicts
from renderer.cuda.cards import cards_from_search, search_command
from renderer.cuda.verdicts import START_KERNELS
from renderer.image import rgbe9995
from renderer.kernel.draft_of_film import draft_of
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.load import read
from renderer.settings import RenderSettings
from tests.chaos.test_digest import VIEW, digest_without_farm, submit, upload
from tests.helpers import ROOT, Farm, start_farm, stop_farm, wait_until
from tests.renderer.cuda.on_host import fake_driver, shared_objects
from tests.service.viewer import Viewer

# The first test that needs a kernel builds it for the card and for the CPU, minutes of a core.
pytestmark = [pytest.mark.long, pytest.mark.timeout(1200)]

SPP = 320


@pytest.fixture(scope="module")
def driver(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Returns environment variables with which a process finds the test's simulated graphics card, which passes the self-test."""
    folder = tmp_path_factory.mktemp("driver")
    fake_driver(folder)
    variables = {"LD_LIBRARY_PATH": str(folder), "FAKE_CUDA_KERNEL": str(folder / "kernels")}
    build(variables, *START_KERNELS)
    return variables


def build(driver: dict[str, str], *kernels: str) -> None:
    """Builds kernels for the simulated card, which then passes its self-test with them."""
    shared_objects(kernels, Path(driver["FAKE_CUDA_KERNEL"]))
    environment = {**os.environ, **driver, "FAKE_CUDA_CARDS": "RTX Test:8:6:8192"}
    subprocess.run([sys.executable, "-m", "renderer.self_test", *kernels], cwd=ROOT, env=environment, check=True)


@pytest.fixture(scope="module")
def inexact_driver(driver: dict[str, str], tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """Returns the variables of a driver whose card, another one, rounds twice in a stage; its verdicts are deleted at the end."""
    kernels = shared_objects(START_KERNELS, tmp_path_factory.mktemp("inexact") / "kernels", unfused="scatter_conductor")
    variables = {**driver, "FAKE_CUDA_KERNEL": str(kernels), "FAKE_CUDA_CARDS": "RTX Test:8:6:8192", "FAKE_CUDA_UUID": "7"}

    def forget() -> None:
        found = subprocess.run(
            search_command(), cwd=ROOT, env={**os.environ, **variables}, capture_output=True, text=True, check=True
        )
        for card in cards_from_search(0, found.stdout, "").usable:
            verdicts._path(card).unlink(missing_ok=True)

    forget()
    yield variables
    forget()


@pytest.fixture(scope="module")
def expected() -> str:
    return digest_without_farm(SPP)


@pytest.fixture
def farm(tmp_path: Path) -> Iterator[Farm]:
    farm = start_farm(tmp_path / "data", 1)
    yield farm
    stop_farm(farm)


def join(farm: Farm, ends: ExitStack, driver: dict[str, str], megabytes: int, *options: str) -> subprocess.Popen[bytes]:
    """Starts a worker with a graphics card of `megabytes` of memory; returns when the worker is ready."""
    command = [sys.executable, "-m", "worker", "--service", farm.url, "--name", "attic-gpu", "--gpu", "only", *options]
    log = ends.enter_context((farm.data.parent / "gpu.log").open("ab"))
    environment = {**os.environ, **driver, "FAKE_CUDA_CARDS": f"RTX Test:8:6:{megabytes}", "RAYFARM_TOKEN": farm.token}
    process = subprocess.Popen(
        command, cwd=ROOT, env=environment, stdout=log, stderr=log, start_new_session=True, preexec_fn=spawn_guard()
    )
    ends.callback(process.wait)
    ends.callback(process.terminate)
    workers = lambda: {each["name"]: each["state"] for each in get(farm, "/api/workers").json()}  # noqa: E731
    wait_until(lambda: workers().get("attic-gpu") == "ready", 120, "the worker with the card has joined")
    return process


def get(farm: Farm, path: str) -> Any:
    return httpx.get(farm.url + path, timeout=60).raise_for_status()


def finish(farm: Farm, job: str, expected: str) -> str:
    """Waits for the job, checks that its digest is `expected`, and returns its log."""
    with farm.client() as client:
        final = client.wait(job, timeout_s=240)
        assert final.state == "finished", f"{final}\n{farm.logs()}\n{(farm.data.parent / 'gpu.log').read_text()}"
        assert client.digest(job) == expected
    return str(get(farm, f"/api/jobs/{job}/log").text)


def test_a_frame_of_cores_and_a_card_has_the_digest_of_the_cores(farm: Farm, driver: dict[str, str], expected: str) -> None:
    with ExitStack() as ends:
        join(farm, ends, driver, 8192, "--paired")
        log = finish(farm, submit(farm, SPP, tile_size=16), expected)
        workers = lambda: {each["name"]: each for each in get(farm, "/api/workers").json()}  # noqa: E731
        wait_until(lambda: workers()["attic-gpu"]["cards"][0]["samples_per_s"] > 0, 20, "the card's speed is reported")
        names = list(workers())
    for name in names:
        assert f"{name}: " in log, log


def test_farm_uses_a_card_that_passes_the_self_test(tmp_path: Path, driver: dict[str, str], expected: str) -> None:
    """`rayfarm up` without options starts a second worker for the card; a job of both has the digest of the cores."""
    farm = start_farm(tmp_path / "data", 1, gpu="auto", FAKE_CUDA_CARDS="RTX Test:8:6:8192,GTX Test:6:1:4096", **driver)
    try:
        rows = lambda: {each["name"]: each for each in get(farm, "/api/workers").json()}  # noqa: E731
        wait_until(lambda: any(row["cards"] and row["state"] == "ready" for row in rows().values()), 120, "the card is used")
        first, second = sorted(rows())
        assert second == f"{first}-gpu"
        assert rows()[first]["cards"] == []
        assert len(rows()[first]["cards_unused"]) == 1
        assert "compute capability 6.1 is not used: Rayfarm needs" in rows()[first]["cards_unused"][0]
        assert [card["number"] for card in rows()[second]["cards"]] == [0]
        log = finish(farm, submit(farm, SPP, tile_size=16), expected)
        assert f"{second}: " in log
    finally:
        stop_farm(farm)
    assert not [each for each in psutil.process_iter(["cmdline"]) if f"--name={second}" in (each.info["cmdline"] or [])]


def test_farm_leaves_out_a_card_that_computes_other_bits(tmp_path: Path, inexact_driver: dict[str, str], expected: str) -> None:
    farm = start_farm(tmp_path / "data", 1, gpu="auto", **inexact_driver)
    try:
        (row,) = get(farm, "/api/workers").json()
        job = submit(farm, SPP, tile_size=16)
        unused = lambda: get(farm, "/api/workers").json()[0]["cards_unused"]  # noqa: E731
        wait_until(lambda: "computed other bits in the self-test" in str(unused()), 240, "the reason is reported")
        assert [each["name"] for each in get(farm, "/api/workers").json()] == [row["name"]]
        finish(farm, job, expected)
        environment = {**os.environ, **inexact_driver, "RAYFARM_TOKEN": farm.token}
        options = [f"--join={farm.url}", "--slots=1", "--name=attic", "--gpu=all"]
        for command in (["worker", *options], ["workers", f"--server={farm.url}"], ["doctor"]):
            done = subprocess.run(
                [sys.executable, "-m", "rayfarm", *command],
                cwd=ROOT,
                env=environment,
                capture_output=True,
                text=True,
                check=False,
            )
            said = " ".join((done.stdout + done.stderr).split())
            assert "is not used: it computed other bits in the self-test: " in said, said
            assert done.returncode == int(command[0] == "worker"), said
    finally:
        stop_farm(farm)


def test_light_paths_of_cores_and_a_card_have_the_digest_of_the_cores(farm: Farm, driver: dict[str, str]) -> None:
    build(driver, "plain-paths")
    expected = digest_without_farm(SPP, light_paths="on")
    with ExitStack() as ends:
        join(farm, ends, driver, 8192, "--paired")
        log = finish(farm, submit(farm, SPP, tile_size=16, light_paths="on"), expected)
    assert "attic-gpu: " in log, log
    assert "the processor does" not in log, log


def test_slot_with_a_card_trains_the_guide_while_the_cores_are_paused(farm: Farm, driver: dict[str, str]) -> None:
    spp = SPP // 5
    build(driver, "plain-guided")
    expected = digest_without_farm(spp, guiding="on")  # and the kernels that train a guide are compiled
    with ExitStack() as ends, farm.client() as client:
        upload(farm)  # cores that are paused prepare no scene
        join(farm, ends, driver, 8192, "--paired")
        (cores,) = (row.name for row in client.workers() if row.name != "attic-gpu")
        client.call("PATCH", f"/api/workers/{cores}", state="paused")
        paused = lambda: {row.name: row.state for row in client.workers()}[cores] == "paused"  # noqa: E731
        wait_until(paused, 30, "the cores are paused")
        log = finish(farm, submit(farm, spp, guiding="on"), expected)
    assert "attic-gpu: " in log, log


def test_a_killed_worker_with_a_card_leaves_no_trace(farm: Farm, driver: dict[str, str], expected: str) -> None:
    with ExitStack() as ends:
        process = join(farm, ends, driver, 8192, "--paired")
        job = submit(farm, SPP, tile_size=16)
        with farm.client() as client:
            wait_until(lambda: client.job(job).progress > 0.2, 120, "the job is well under way")
        os.killpg(process.pid, signal.SIGKILL)
        finish(farm, job, expected)


def test_a_scene_that_does_not_fit_the_card_is_left_to_the_cores(farm: Farm, driver: dict[str, str], expected: str) -> None:
    with ExitStack() as ends:
        join(farm, ends, driver, 0, "--paired")
        log = finish(farm, submit(farm, SPP, tile_size=16), expected)
    assert "attic-gpu: The scene does not fit the memory of card 0" in log


def exact_view(depth: int, spp: int) -> np.ndarray:
    """Returns the RGB9E5 words (64, 96) of the view that the tests open, rendered in this process with the CPU."""
    scene = compile_scene(read(ROOT / "scenes", "cornell-box.yaml"))
    settings = RenderSettings(96, 64, VIEW, max_depth=depth)
    return rgbe9995.pack(film.mean(render_frame(scene, settings, spp, threads=2), settings.film_exponent))


@pytest.mark.parametrize("trouble", ("alone", "killed", "memory"))
def test_view_with_a_card_has_the_bits_of_the_cores(tmp_path: Path, driver: dict[str, str], expected: str, trouble: str) -> None:
    """A card renders views and a job alone, or a view beside cores; it is killed half way, or lacks the memory. All is exact."""
    farm = start_farm(tmp_path / "data", int(trouble != "alone"), b"Ready" if trouble != "alone" else b"http://")
    view = {"eye": VIEW.eye, "target": VIEW.target, "up": VIEW.up, "fov": VIEW.fov}

    def show(id: int, depth: int) -> None:
        viewer.say(id=id, view=view, width=96, height=64, spp=64, max_depth=depth)
        viewer.wait(id, 1)

    def check(id: int, depth: int) -> float:
        """Waits until the view is exact and compares it with the CPU's. Returns the seconds waited."""
        begun = time.monotonic()
        is_exact = lambda: (viewer.read(), viewer.pictures[-1][0] == id and viewer.is_exact.all())[1]  # noqa: E731
        wait_until(is_exact, 90, f"view {id} is exact")
        seconds = time.monotonic() - begun
        assert (viewer.words == exact_view(depth, 64)).all()
        assert not viewer.errors
        return seconds

    def is_card_used() -> bool:
        workers = {each["name"]: each for each in get(farm, "/api/workers").json()}
        return bool(workers["attic-gpu"]["cards"][0]["samples_per_s"] > 0)

    with ExitStack() as ends:
        ends.callback(stop_farm, farm)
        process = join(farm, ends, driver, 0 if trouble == "memory" else 8192, *(["--paired"] if trouble != "alone" else []))
        with farm.client() as client:
            scene = client.wait_for_scene(client.upload([ROOT / "scenes" / "cornell-box.yaml"]).id)
        address = f"{farm.url.replace('http', 'ws')}/api/scenes/{scene.id}/viewport"
        viewer = Viewer(ends.enter_context(connect(address, max_size=None)))
        id, deadline = 1, time.monotonic() + 240
        while not is_card_used() and trouble != "memory":  # its kernel is built, in a minute of a core
            assert time.monotonic() < deadline
            show(id, 4 + id % 2)
            id += 1
            viewer.read(1)
        show(id, 5)
        if trouble == "killed":
            os.killpg(process.pid, signal.SIGKILL)
        seconds = check(id, 5)
        assert trouble != "killed" or seconds < 30
        show(id + 1, 4)
        check(id + 1, 4)
        if trouble == "alone":
            viewer.say(id=id + 3, view=view, width=96, height=64, spp=64, max_depth=5, draft=1.0)
            check(id + 3, 5)
            ((head, jpeg),) = viewer.drafts
            assert head.id == id + 3
            shown = np.asarray(Image.open(io.BytesIO(jpeg)))
            assert shown.shape == (head.h, head.w, 3)
            settings = RenderSettings(head.w, head.h, VIEW, max_depth=5)
            scene_of_cores = compile_scene(read(ROOT / "scenes", "cornell-box.yaml"))
            words = draft_of(render_frame(scene_of_cores, settings, head.samples, threads=2), settings.film_exponent, 1.0)
            wanted = words[..., None].view(np.uint8).reshape(head.h, head.w, 4)[..., :3]
            luma = np.array([0.299, 0.587, 0.114])  # its error is that of the JPEG, colour has a quarter of the pixels
            assert np.abs(shown @ luma - wanted @ luma).mean() < 8
            job = submit(farm, SPP, tile_size=16)
            with farm.client() as client:
                wait_until(lambda: client.job(job).progress > 0.05, 60, "the job is rendered")
                begun = time.monotonic()
                show(id + 2, 5)
                print(f"the first whole picture beside the job after {time.monotonic() - begun:.2f} s")
                assert client.job(job).state == "running", "the view does not wait for the job"
            check(id + 2, 5)
            finish(farm, job, expected)
    if trouble != "killed":
        said = (tmp_path / "gpu.log").read_text()
        assert ("the processor renders" in said) == (trouble == "memory"), said
