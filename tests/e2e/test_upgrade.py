"""Tests of the button that restarts a job for which no suitable workers exist any more, with real workers of two releases."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from playwright.sync_api import expect

from renderer.child_processes import spawn_guard
from tests.e2e.conftest import Watched
from tests.helpers import ROOT, running_redis
from tests.service.conftest import TOKEN, Service, until

# A worker whose release, and the beginning of whose kind, is the first argument.
WORKER = "import renderer, runpy, sys; renderer.__version__ = sys.argv.pop(1); runpy.run_module('worker', run_name='__main__')"
SPP = 16384


@contextmanager
def worker_of(release: str, service: Service, folder: Path) -> Iterator[None]:
    """Runs a worker of this release in the `with` block, from the moment it is ready; ends it by SIGTERM, as a shutdown does."""
    command = [sys.executable, "-c", WORKER, release, f"--service={service.url}", "--slots=1", f"--name={release}"]
    log = folder / f"{release}.log"
    with log.open("wb") as out:
        process = subprocess.Popen(
            [*command, f"--cache={folder / 'blobs'}"],
            cwd=ROOT,
            env={**os.environ, "RAYFARM_TOKEN": TOKEN},
            stdout=out,
            stderr=out,
            preexec_fn=spawn_guard(),
        )
    try:
        ready = {"name": release, "state": "ready"}.items()
        workers = service.http
        until(
            lambda: any(ready <= each.items() for each in workers.get("/api/workers").json()),
            f"the worker of {release} is ready",
            240,
            lambda: log.read_text(),
        )
        yield
    finally:
        process.terminate()
        process.wait(60)


@pytest.mark.long
def test_job_without_workers_after_upgrade_is_restarted_by_button(tmp_path: Path, watched: Watched) -> None:
    page = watched.page
    redis = running_redis(tmp_path)
    with redis:
        data = tmp_path / "data"
        data.mkdir()
        service = Service(data, redis)
        try:
            with worker_of("0.0.1", service, tmp_path):
                scene = service.upload()
                until(
                    lambda: service.scene(scene)["status"] == "ready", "the scene is prepared", 120, lambda: service.scene(scene)
                )
                job = service.submit(scene, spp=SPP, name="shot 12")
                page.goto(f"{service.url}/#/jobs/{job}")
                anew = page.get_by_role("button", name="Start over")
                until(lambda: service.job(job)["samples"] > 0, "the old worker has begun", 60, lambda: service.job(job))
                expect(anew).to_be_hidden()
            old_kind = service.job(job)["kind"]
            with worker_of("0.0.2", service, tmp_path):
                progress = page.get_by_role("region", name="Progress")
                expect(progress.get_by_text(f"Waits for a worker of the kind {old_kind}")).to_be_visible()
                anew.click()
                expect(page).not_to_have_url(f"{service.url}/#/jobs/{job}")
                made = page.url.rpartition("/")[2]
                until(lambda: service.job(made)["samples"] > 0, "the new job renders", 60, lambda: service.job(made))
                new_kind = service.job(made)["kind"]
                assert (old_kind[:6], new_kind[:6]) == ("0.0.1-", "0.0.2-")
                assert old_kind[6:] == new_kind[6:], "the version alone is another"
                assert service.job(made)["name"] == "shot 12"
                left = service.job(job)
                assert (left["state"], left["samples"] > 0) == ("cancelled", True)
                expect(anew).to_be_hidden()
                expect(page.locator(".job-head .chip:not(.verdict)")).to_have_text("Rendering")
                service.patch(made, state="cancelled")
        finally:
            page.goto("about:blank")  # closes the page's event stream, for which the service would wait
            service.stop()
    assert watched.errors == []
