"""Tests of the commands `rayfarm backup`, `restore` and `gc`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.rayfarm.program import rayfarm
from tests.service.conftest import Service


@pytest.fixture
def job(service: Service) -> str:
    with service.worker():
        job = service.submit(service.ready_scene())
        service.wait_for(job, "finished")
    return job


def test_running_farm_is_backed_up_and_restored(service: Service, job: str, tmp_path: Path) -> None:
    data, copy, again = service.options["data"], tmp_path / "copy.tar", tmp_path / "again"
    done = rayfarm("backup", copy, "--data", data, COLUMNS="200")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("1 film and ")
    done = rayfarm("backup", copy, "--data", data, COLUMNS="200")
    assert (done.returncode, "exists already. Name another file, or remove it" in done.stderr) == (1, True)
    done = rayfarm("restore", copy, "--data", again, COLUMNS="200")
    assert done.returncode == 0, done.stderr
    assert f"up --data {again}" in done.stdout
    assert (again / "films" / f"{job}.sqlite").stat().st_mode & 0o777 == 0o600
    done = rayfarm("restore", copy, "--data", again, COLUMNS="200")
    assert (done.returncode, "is not empty" in done.stderr) == (1, True)
    done = rayfarm("backup", copy, "--data", again, RAYFARM_DATABASE_URL="postgresql://farm@db/farm", COLUMNS="200")
    assert (done.returncode, "pg_dump" in done.stderr) == (1, True)


@pytest.mark.long
def test_gc_lists_then_deletes_when_confirmed(service: Service, job: str) -> None:
    asked = ("gc", "--films-older-than=0", "--server", service.url)
    shown = rayfarm(*asked, "--dry-run", COLUMNS="200").stdout
    assert job in shown
    assert "1 would be deleted" in shown
    unsure = rayfarm(*asked, COLUMNS="200")
    assert (unsure.returncode, "Nothing was deleted" in unsure.stderr) == (1, True)
    assert service.job(job)["state"] == "finished"
    gone = json.loads(rayfarm(*asked, "--yes", "--json", COLUMNS="200").stdout)
    assert [item["id"] for item in gone["items"]] == [job]
    assert service.job(job)["state"] == "cancelled"
    assert "These rules delete nothing" in rayfarm(*asked, COLUMNS="200").stdout
