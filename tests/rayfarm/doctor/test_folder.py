"""Tests of `rayfarm doctor` on data folders: each fault is reported, and intact parts are not."""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from rayfarm.doctor import folder as looked_at
from rayfarm.doctor.finding import Finding
from rayfarm.doctor.folder import check_folder
from service.settings import Settings
from tests.service.conftest import Service
from tests.service.store.test_lost_films import damage_film, one_bit


def check_lines(data: Path, deep: bool = False, **settings: int) -> list[Finding]:
    return list(check_folder(Settings(data=data, **settings), deep, lambda done, total: None))  # type: ignore[arg-type]


def faults(data: Path, deep: bool = False) -> list[str]:
    return [f"{each.about}: {each.says}" for each in check_lines(data, deep) if each.level == "fault"]


@pytest.fixture
def data_folder(service: Service) -> Path:
    """Returns the data folder of a service with one finished job; the service's periodic check of films is disabled."""
    with service.worker():
        service.wait_for(service.submit(service.ready_scene()), "finished")
    service.options["film_check_days"] = 0
    service.restart()
    data: Path = service.options["data"]
    return data


def film(data: Path) -> Path:
    return next((data / "films").glob("*.sqlite"))


def blob(data: Path) -> Path:
    return next(path for path in (data / "blobs").rglob("*") if path.is_file())


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)


@pytest.mark.long
def test_intact_folder_has_no_fault_while_farm_runs(data_folder: Path) -> None:
    found = check_lines(data_folder, deep=True)
    assert {each.level for each in found if each.about != "Room"} == {"fine"}
    assert [each.about for each in found] == ["Data folder", "Room", "Database", "Uploads", "Films"]


@pytest.mark.long
@pytest.mark.parametrize(
    ("break_it", "deep", "sentence"),
    [
        pytest.param(lambda data: blob(data).unlink(), False, "Uploads: Of .* 1 are not there", marks=pytest.mark.long),
        (lambda data: flip(blob(data)), True, "Uploads: Of .* 1 are damaged"),
        pytest.param(
            lambda data: film(data).unlink(),
            False,
            "Films: Of 1 finished jobs 1 have a damaged film or none",
            marks=pytest.mark.long,
        ),
        pytest.param(
            lambda data: one_bit(film(data)),
            True,
            "Films: Of 1 finished jobs 1 have a damaged film or none",
            marks=pytest.mark.long,
        ),
        (
            lambda data: (data / "token").write_text("open") and (data / "token").chmod(0o644),
            False,
            "Secrets: Others can read token",
        ),
    ],
)
def test_faults_of_folder_are_reported(data_folder: Path, break_it: Callable[[Path], object], deep: bool, sentence: str) -> None:
    break_it(data_folder)
    (said,) = faults(data_folder, deep)
    assert re.match(sentence, said), said
    if deep:
        assert faults(data_folder) == [], "found only by reading the files"


@pytest.mark.long
def test_damaged_and_newer_databases_are_reported(service: Service, data_folder: Path) -> None:
    service.stop()
    try:
        with closing(sqlite3.connect(data_folder / "rayfarm.sqlite")) as database, database:
            (revision,) = database.execute("SELECT version_num FROM alembic_version").fetchone()
            database.execute("UPDATE alembic_version SET version_num = '9999'")
        database.close()
        assert "newer release (revision 9999" in faults(data_folder)[0]
        whole = (data_folder / "rayfarm.sqlite").read_bytes()
        damage_film(data_folder / "rayfarm.sqlite")
        assert "Database: " in faults(data_folder)[0]
        assert "is damaged" in faults(data_folder)[0]
        (data_folder / "rayfarm.sqlite").write_bytes(whole)
        with closing(sqlite3.connect(data_folder / "rayfarm.sqlite")) as database, database:
            database.execute("DELETE FROM alembic_version")
        database.close()
        assert [each.says for each in check_lines(data_folder) if each.level == "note" and "older release" in each.says]
    finally:
        with closing(sqlite3.connect(data_folder / "rayfarm.sqlite")) as database, database:
            database.execute("DELETE FROM alembic_version")
            database.execute("INSERT INTO alembic_version VALUES (?)", (revision,))
        database.close()
        service.start()


def test_permissions_space_and_network_drives_are_checked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = tmp_path / "data"
    assert [each.level for each in check_lines(data)] == ["note"], "it is not there yet"
    data.mkdir(0o755)
    assert "Others on this machine can look into" in check_lines(data)[0].says
    assert any(each.about == "Room" and each.level == "fault" for each in check_lines(data, min_free_bytes=1 << 60))
    monkeypatch.setattr(looked_at, "_file_system", lambda folder: "nfs4")
    assert any("network drive (nfs4)" in each.says for each in check_lines(data))
    (tmp_path / "file").touch()
    assert check_lines(tmp_path / "file")[0].level == "fault"
