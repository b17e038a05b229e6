"""Tests of `rayfarm watch` with a real service: on a pseudo terminal, in a pipe, with tev and with another viewer."""

from __future__ import annotations

import io
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from PIL import Image

from tests.helpers import ROOT
from tests.rayfarm.program import rayfarm, run_program
from tests.rayfarm.watch.tev_server import TevServer
from tests.rayfarm.watch.window import CELL, DA1, DA1_WITH_SIXEL, KITTY, Window
from tests.service.conftest import Service, until
from tests.service.peer_worker import PeerWorker


def png(service: Service, job: str, **query: float | str) -> np.ndarray:
    answer = service.http.get(f"/api/jobs/{job}/frames/0/image.png", params=query).raise_for_status()
    return np.asarray(Image.open(io.BytesIO(answer.content)).convert("RGB")).astype(int)


def is_close(a: np.ndarray, b: np.ndarray) -> bool:
    """Returns whether two pictures have the same shape, and values that differ by at most 2, which allows for RGB9E5 rounding."""
    return a.shape == b.shape and bool(np.abs(a.astype(int) - b).max() <= 2)


def finished_job(service: Service, **request: int) -> str:
    job = service.submit(service.ready_scene(), **request)
    service.wait_for(job, "finished")
    return job


def test_terminal_shows_picture_of_job(service: Service, worker: PeerWorker) -> None:
    job = finished_job(service)
    with Window("watch", job, "--server", service.url) as window:
        window.says("finished")
        window.wait_for(lambda: is_close(window.screen.blocks(), png(service, job)), "the PNG's pixels")
        window.says("8 of 8 spp")
        window.press("++")
        window.wait_for(lambda: is_close(window.screen.blocks(), png(service, job, exposure=1)), "brighter by a stop")
        window.press("t")
        window.wait_for(lambda: is_close(window.screen.blocks(), png(service, job, exposure=1, tonemap="srgb")), "another curve")
        window.resize(41, 12)
        window.wait_for(lambda: window.screen.blocks().shape == (18, 24, 3), "as large as there is room for")
        window.says("finished")
        window.press("q")
        code, err = window.ends()
    assert code == 0, err
    assert "finished" in err and "64x48" in err


@pytest.mark.long
def test_picture_grows_and_cancelling_needs_confirmation(service: Service, worker: PeerWorker) -> None:
    worker.on_batch = lambda batch: time.sleep(0.05)
    job = service.submit(service.ready_scene(), spp=100_000)
    with Window("watch", "--server", service.url) as window:  # without a job: the newest one
        window.wait_for(lambda: window.screen.blocks().shape == (48, 64, 3) and window.screen.blocks().any(), "there is light")
        before = len(window.screen.drawn)
        window.wait_for(lambda: len(window.screen.drawn) > before + 50, "it is drawn again")
        window.press("c")
        window.says("Cancel this job?")
        window.press("n")
        window.says("q quit")
        assert service.job(job)["state"] == "running"
        window.press("cy")
        until(lambda: service.job(job)["state"] == "cancelled", "it is cancelled")
        window.says("cancelled")
        window.press("q")
        assert window.ends()[0] == 0
    assert window.raw.count(b"\x1b[2J") <= 4, "it does not clear the screen to draw"


@pytest.mark.long
@pytest.mark.parametrize(
    ("number", "code"),
    [(signal.SIGINT, 130), *(pytest.param(number, 0, marks=pytest.mark.long) for number in (signal.SIGTERM, signal.SIGHUP))],
)
def test_signal_restores_terminal(service: Service, worker: PeerWorker, number: signal.Signals, code: int) -> None:
    worker.on_batch = lambda batch: False
    job = service.submit(service.ready_scene())
    with Window("watch", job, "--server", service.url) as window:
        window.says("q quit")
        window.send(number)
        ended, err = window.ends()
    assert ended == code
    assert f"watch {job}" in err
    assert service.job(job)["state"] in ("queued", "running")


@pytest.mark.long
def test_pixel_graphics_are_used_if_supported(service: Service, worker: PeerWorker) -> None:
    job = finished_job(service)
    expected = png(service, job).repeat(11, 0).repeat(11, 1)  # by the largest integer scale that fits
    with Window("watch", job, "--server", service.url, answers=KITTY + CELL + DA1) as window:
        window.wait_for(lambda: any(is_close(image, expected) for image in window.screen.images.values()), "kitty's image")
        window.press("q")
        assert window.ends()[0] == 0
        assert not window.screen.images
    with Window("watch", job, "--server", service.url, answers=CELL + DA1_WITH_SIXEL) as window:
        window.wait_for(
            lambda: (
                window.screen.sixel is not None
                and window.screen.sixel.shape == expected.shape
                and np.abs(window.screen.sixel - expected).mean() < 12
            ),
            "sixels, in 256 colours",
        )
        window.press("q")
        assert window.ends()[0] == 0


@pytest.mark.long
def test_unreachable_farm_and_deleted_job_end_watch(service: Service, worker: PeerWorker) -> None:
    job = finished_job(service)
    with Window("watch", job, "--server", service.url) as window:
        window.says("finished")
        service.http.delete(f"/api/jobs/{job}").raise_for_status()
        code, err = window.ends()
    assert code == 1
    assert "was deleted" in err or "no job" in err


@pytest.mark.long
def test_pipe_gets_progress_lines_until_job_ends(service: Service, worker: PeerWorker) -> None:
    done = run_program("watch", finished_job(service), "--server", service.url)
    assert done.returncode == 0, done.stderr
    assert "\x1b" not in done.stdout
    assert "finished" in done.stdout.splitlines()[-1]
    worker.on_batch = lambda batch: False
    job = service.submit(service.ready_scene(), seed=3)
    command = [sys.executable, "-m", "rayfarm", "watch", job, "--server", service.url]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline()
        service.patch(job, state="cancelled")
        out, err = process.communicate(timeout=60)
    assert process.returncode == 1
    assert "cancelled" in out
    assert "was cancelled" in err


@pytest.mark.long
def test_tev_gets_growing_film_and_viewer_gets_exr(service: Service, worker: PeerWorker, tmp_path: Path) -> None:
    worker.on_batch = lambda batch: time.sleep(0.02)
    job = service.submit(service.ready_scene(), spp=64)
    (tmp_path / "viewer.py").write_text("import sys, shutil; shutil.copy(sys.argv[2], sys.argv[1])\n")
    shown = tmp_path / "shown.exr"
    viewer = f"{sys.executable} {tmp_path / 'viewer.py'} {shown}"
    with TevServer() as tev:
        arguments = (
            "watch",
            job,
            "--server",
            service.url,
            "--tev",
            tev.address,
            "--viewer",
            viewer,
            "-o",
            str(tmp_path / "a.exr"),
        )
        done = run_program(*arguments)
    assert done.returncode == 0, done.stderr
    (name,) = tev.images
    assert job in name
    assert tev.updates > 12, "tile by tile, and again"
    exact = oiio.ImageBuf(str(tmp_path / "a.exr")).get_pixels(oiio.FLOAT)[..., :3]
    np.testing.assert_array_equal(tev.images[name], exact)
    until(lambda: shown.exists() and shown.read_bytes() == (tmp_path / "a.exr").read_bytes(), "the viewer has it")


def test_invalid_options_give_error(service: Service) -> None:
    for arguments, words in (
        (["0000"], "no job '0000'"),
        ([], "no job to watch"),
        (["0000", "--graphics=ascii"], "--graphics"),
        (["0000", "--tonemap=x"], "--tonemap"),
        (["0000", "--tev=a:b"], "HOST:PORT"),
        (["0000", "--viewer", "no-such-program -x"], "no program"),
        (["0000", "-o", "x.exr"], "--viewer"),
    ):
        done = rayfarm("watch", *arguments, "--server", service.url)
        assert done.returncode == 1, arguments
        assert words in done.stderr.replace("\n", " "), done.stderr
        assert "Traceback" not in done.stderr
