"""Tests of migrating a data folder of an older release; a folder of a newer release is refused with an error message."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.migration import MigrationContext
from alembic.operations import Operations
from alembic.script import ScriptDirectory
from sqlalchemy import Engine, create_engine, inspect, text

from service.errors import StartupError
from service.farm import Farm
from service.settings import Settings
from service.store.database import connect
from service.store.migrations.versions import r0001_release_0_1_0
from service.store.models import Base, Job
from service.store.upgrade import MIGRATIONS, schema_state, upgrade
from tests.grids import grid
from tests.service.conftest import Databases, empty_database

# The schema made by release 0.1.0, as in its database (SELECT sql FROM sqlite_master).
RELEASE_0_1_0 = Path(__file__).with_name("release_0_1_0.sql").read_text()


@pytest.fixture
def old_data_folder(tmp_path: Path) -> Path:
    """Returns a data folder of release 0.1.0 with a scene and a finished job."""
    for folder in ("blobs", "films", "tmp"):
        (tmp_path / folder).mkdir()
    (tmp_path / "token").write_text("token\n")
    database = sqlite3.connect(tmp_path / "rayfarm.sqlite")
    database.execute("PRAGMA journal_mode=WAL")
    database.executescript(RELEASE_0_1_0)
    ref = json.dumps([{"path": "scene.obj", "sha256": "0" * 64, "size": 3}])
    database.execute(
        "INSERT INTO scenes VALUES ('scene', 'A scene', 'ready', NULL, 1.0, 'scene.obj', NULL, ?, 3, '[]', NULL, '{}')", (ref,)
    )
    database.execute(
        "INSERT INTO jobs (id, scene, name, state, priority, created, active_s, request) "
        "VALUES ('job', 'scene', 'A job', 'finished', 0, 1.0, 2.5, '{}')"
    )
    database.execute("INSERT INTO frames VALUES ('job', 0, 8, 8, 0, 1.0)")
    database.commit()
    database.close()
    return tmp_path


def differences(engine: Engine) -> list[object]:
    with engine.connect() as connection:
        return list(compare_metadata(MigrationContext.configure(connection), Base.metadata))


def test_revisions_in_file_names_equal_alembic(tmp_path: Path) -> None:
    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS))
    scripts = ScriptDirectory.from_config(config)
    revisions = [script.revision for script in scripts.walk_revisions()]
    engine = create_engine(f"sqlite:///{tmp_path / 'new.sqlite'}")
    try:
        assert schema_state(engine).head == scripts.get_current_head() == revisions[0]
    finally:
        engine.dispose()
    assert sorted(revisions) == sorted(path.name[1:5] for path in (MIGRATIONS / "versions").glob("r*.py"))
    assert all(Path(script.path).name.startswith(f"r{script.revision}_") for script in scripts.walk_revisions())


def test_data_folder_of_release_0_1_0_is_migrated(old_data_folder: Path) -> None:
    farm = Farm(Settings(data=old_data_folder))
    try:
        job = farm.records.job("job")
        assert job is not None
        assert (job.name, job.state, job.active_s) == ("A job", "finished", 2.5)
        assert farm.records.blobs() == {"0" * 64}
        assert farm.records.samples("job") == 8
        assert differences(farm.database) == []
    finally:
        farm.stop()
    Farm(Settings(data=old_data_folder)).stop()  # again, now that it is of this release


def test_newer_database_is_rejected_unchanged(old_data_folder: Path) -> None:
    farm = Farm(Settings(data=old_data_folder))
    farm.stop()
    with closing(sqlite3.connect(old_data_folder / "rayfarm.sqlite")) as database, database:
        database.execute("UPDATE alembic_version SET version_num = '9999'")
    database.close()
    with pytest.raises(StartupError, match=r"newer release of Rayfarm \(revision 9999; this release knows up to"):
        Farm(Settings(data=old_data_folder))
    with closing(sqlite3.connect(old_data_folder / "rayfarm.sqlite")) as database, database:
        assert database.execute("SELECT version_num FROM alembic_version").fetchall() == [("9999",)]
    database.close()


def test_migrated_schema_equals_models(tmp_path: Path) -> None:
    engine, _ = connect(f"sqlite:///{tmp_path / 'new.sqlite'}")
    assert differences(engine) == []
    engine.dispose()


def test_failed_migration_is_rolled_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("in the middle")

    monkeypatch.setattr("alembic.op.create_index", fail)
    engine = create_engine(f"sqlite:///{tmp_path / 'new.sqlite'}")
    with pytest.raises(RuntimeError, match="in the middle"):
        connect(f"sqlite:///{tmp_path / 'new.sqlite'}")
    assert inspect(engine).get_table_names() == []
    engine.dispose()


@pytest.fixture
def postgres(databases: Databases) -> Iterator[Engine]:
    """Yields an empty PostgreSQL database."""
    server = None if databases.given.startswith("postgresql") else databases.server()
    url = databases.given if server is None else server.new_empty("upgraded")
    engine = create_engine(url)
    yield engine
    engine.dispose()
    if server is not None:
        server.drop(url)


@grid("is_old", [False, True], ordinary=(True,))
def test_migration_on_postgresql(postgres: Engine, is_old: bool) -> None:
    empty_database(postgres.url.render_as_string(hide_password=False))
    if is_old:
        with postgres.begin() as connection:
            operations = Operations(MigrationContext.configure(connection))
            with Operations.context(operations.migration_context):
                r0001_release_0_1_0.upgrade()  # the tables of that release, which recorded no revision
            columns = "id, scene, name, state, priority, created, active_s, request"  # the columns of that release
            connection.execute(text(f"INSERT INTO jobs ({columns}) VALUES ('job', 's', '', 'finished', 0, 0, 0, '{{}}')"))
    engine, sessions = connect(postgres.url.render_as_string(hide_password=False))
    assert differences(engine) == []
    with sessions() as session:
        assert (session.get(Job, "job") is not None) == is_old
    upgrade(engine)
    engine.dispose()
