"""Tests of finished jobs with a damaged film: requests get an error, and missing samples are rendered again."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from sqlalchemy import delete, update

from service.store.models import Job, Scene
from tests.grids import grid
from tests.service.conftest import Service, until

READERS = ("image.png", "image.exr?aov=normal", "digest", "pixel?x=3&y=4")


@pytest.fixture
def job(service: Service) -> str:
    with service.worker():
        job = service.submit(service.ready_scene())
        service.wait_for(job, "finished")
    return job


def film_of(service: Service, job: str) -> Path:
    data: Path = service.options["data"]
    return data / "films" / f"{job}.sqlite"


def damage_film(path: Path) -> None:
    with path.open("r+b") as file:
        file.seek(100)
        file.write(b"\xa5" * 60_000)


def half_of_it(path: Path) -> None:
    database = sqlite3.connect(path)
    database.execute("DELETE FROM part WHERE tile < 6")
    database.commit()
    database.close()


@pytest.mark.long
@grid(
    ("break_it", "sentence"),
    [
        (damage_film, "is damaged"),
        pytest.param(lambda path: path.write_bytes(b""), "is missing or was emptied", marks=pytest.mark.long),
        (Path.unlink, "is missing or was emptied"),
        (half_of_it, "has only 12288 of its 24576 samples"),
    ],
    ordinary=(damage_film,),
)
def test_readers_of_damaged_film_get_error(service: Service, job: str, break_it: Callable[[Path], object], sentence: str) -> None:
    service.stop()
    break_it(film_of(service, job))
    service.options["film_check_days"] = 0  # disables automatic repair
    service.start()
    for reader in READERS:
        answer = service.http.get(f"/api/jobs/{job}/frames/0/{reader}")
        assert answer.status_code == 409, f"{reader}: {answer.text[:200]}"
        assert sentence in answer.json()["detail"]
        assert "Set the job to running" in answer.json()["detail"]
    assert service.job(job)["state"] == "finished"
    assert [each["id"] for each in service.http.get("/api/jobs").raise_for_status().json()] == [job]
    assert service.http.delete(f"/api/jobs/{job}").status_code == 204


@pytest.mark.long
def test_locked_film_is_read_later(service: Service, job: str) -> None:
    service.restart()
    other = sqlite3.connect(film_of(service, job), isolation_level=None)
    other.execute("PRAGMA locking_mode=EXCLUSIVE")
    other.execute("BEGIN EXCLUSIVE")
    for reader in READERS:
        answer = service.http.get(f"/api/jobs/{job}/frames/0/{reader}")
        assert answer.status_code == 503
        assert "locked by another program" in answer.json()["detail"]
    other.execute("ROLLBACK")
    other.close()
    for reader in READERS:
        assert service.http.get(f"/api/jobs/{job}/frames/0/{reader}").status_code == 200


def one_bit(path: Path) -> None:
    database = sqlite3.connect(path)
    (sums,) = database.execute("SELECT sums FROM part WHERE tile = 3").fetchone()
    turned = bytearray(sums)
    turned[-1] ^= 1
    database.execute("UPDATE part SET sums = ? WHERE tile = 3", (bytes(turned),))
    database.commit()
    database.close()


@grid(
    ("break_it", "tiles"),
    [
        pytest.param(damage_film, 12, marks=pytest.mark.long),
        pytest.param(lambda path: path.write_bytes(b""), 12, marks=pytest.mark.long),
        (half_of_it, 6),
        (one_bit, 1),
    ],
    ordinary=(one_bit,),
)
def test_missing_samples_are_rendered_again(service: Service, job: str, break_it: Callable[[Path], object], tiles: int) -> None:
    digest = service.digest(job)
    service.stop()
    break_it(film_of(service, job))
    service.start()
    until(lambda: service.job(job)["state"] == "queued", "the damage is noticed")
    events = service.http.get(f"/api/jobs/{job}/history").json()["events"]
    assert "healed" in [event["kind"] for event in events]
    with service.worker() as worker:
        service.wait_for(job, "finished")
        assert len({batch.tile for batch in worker.batches}) == tiles, "and no more than that"
    assert service.digest(job) == digest


@pytest.mark.long
def test_damage_found_by_reader_is_repaired(service: Service, job: str) -> None:
    digest = service.digest(job)
    with service.farm.sessions.begin() as session:
        session.execute(update(Job).values(checked=time.time()))  # as if checked just now, so that no check is due for a week
    service.restart()
    one_bit(film_of(service, job))
    assert service.http.get(f"/api/jobs/{job}/frames/0/image.png").status_code == 409
    until(lambda: service.job(job)["state"] == "queued", "the damage is looked into")
    with service.worker():
        service.wait_for(job, "finished")
    assert service.digest(job) == digest


@pytest.mark.long
def test_lost_film_of_deleted_scene_gives_error(service: Service, job: str) -> None:
    with service.farm.sessions.begin() as session:
        session.execute(delete(Scene))
    service.stop()
    film_of(service, job).unlink()
    service.start()
    until(lambda: "its scene was deleted" in (service.job(job)["error"] or ""), "it is said")
    assert service.job(job)["state"] == "finished"
