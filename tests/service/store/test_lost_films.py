"""A finished job whose film is not what it was: everybody who asks for its picture is told."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.service.conftest import Service

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


def damaged(path: Path) -> None:
    with path.open("r+b") as file:
        file.seek(100)
        file.write(b"\xa5" * 60_000)


def half_of_it(path: Path) -> None:
    database = sqlite3.connect(path)
    database.execute("DELETE FROM part WHERE tile < 6")
    database.commit()
    database.close()


@pytest.mark.parametrize(
    ("break_it", "sentence"),
    [
        (damaged, "is damaged"),
        (lambda path: path.write_bytes(b""), "is missing or was emptied"),
        (Path.unlink, "is missing or was emptied"),
        (half_of_it, "has only 12288 of its 24576 samples"),
    ],
)
def test_readers_are_told_what_is_wrong(service: Service, job: str, break_it: Callable[[Path], object], sentence: str) -> None:
    service.stop()
    break_it(film_of(service, job))
    service.start()
    for reader in READERS:
        answer = service.http.get(f"/api/jobs/{job}/frames/0/{reader}")
        assert answer.status_code == 409, f"{reader}: {answer.text[:200]}"
        assert sentence in answer.json()["detail"]
        assert "Set the job to running" in answer.json()["detail"]
    assert service.job(job)["state"] == "finished"
    assert [each["id"] for each in service.http.get("/api/jobs").raise_for_status().json()] == [job]
    assert service.http.delete(f"/api/jobs/{job}").status_code == 204


def test_a_film_that_another_program_holds_is_read_later(service: Service, job: str) -> None:
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
