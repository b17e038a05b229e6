"""Fixtures with the real service: uvicorn on a free port, a real Redis, and workers with the real protocol."""

from __future__ import annotations

import functools
import os
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import httpx
import pytest
import redis
import uvicorn
from sqlalchemy import Connection, Engine, create_engine, event, text

from rayfarm.local.farm import free_port
from service.access import passwords
from service.farm import Farm
from service.main import create_app
from service.settings import Settings
from service.store.database import connect
from service.store.models import Base
from tests.helpers import running_redis
from tests.service.peer_worker import PeerWorker
from tests.service.store.postgres import PostgresServer, find_postgres

if TYPE_CHECKING:
    from argon2 import PasswordHasher

TOKEN = "the farm's token"
OVER = ("finished", "failed", "cancelled")
OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
# Test files whose tests with a service run on either database, and name prefixes of the tests that do so without --long: those
# with database queries that other tests do not make.
ON_BOTH: dict[str, tuple[str, ...]] = {
    "scheduling/test_jobs.py": ("test_finished_film_has_expected_sums",),
    "scheduling/test_shots.py": (),
    "scheduling/test_killed_shots.py": (),
    "scheduling/test_many_hands.py": (),
    "scheduling/test_long_shots.py": (),
    "scheduling/jobs/test_history.py": (),
    "scheduling/test_database_faults.py": (),
    "maintenance/test_retention.py": (),
    "store/test_garbage.py": (),
    "ownership/test_candidate.py": ("test_only_one_of_two_candidates", "test_hanging_owner_is_replaced"),
    "ownership/test_two_services.py": (),
}


@functools.cache
def _quick_hasher() -> PasswordHasher:
    """Returns a password hasher with about 1/1000 of the usual work, so that tests spend no time on hashing."""
    from argon2 import PasswordHasher

    return PasswordHasher(time_cost=1, memory_cost=256, parallelism=1)


passwords._hasher = _quick_hasher


# redis reads its package's metadata for each connection pool, so it is cached.
redis.utils.get_lib_version = functools.cache(redis.utils.get_lib_version)


class _Compiled(dict[Any, Any]):
    """A cache of compiled SQL statements that all databases of one kind share.

    SQLAlchemy compiles the statements again for each database, since its cache depends on the dialect object.
    """

    def get(self, key: Any, default: Any = None) -> Any:
        return super().get((key[0].name, *key[1:]), default)

    def __setitem__(self, key: Any, value: Any) -> None:
        super().__setitem__((key[0].name, *key[1:]), value)


_compiled = _Compiled()


@event.listens_for(Engine, "engine_connect")
def _keep_what_is_compiled(connection: Connection) -> None:
    connection.execution_options(compiled_cache=_compiled)


class Service:
    """A real service in a thread of the test process. Redis is emptied before its first start.

    `restart` stops the service, and starts it again with the same data folder.
    """

    def __init__(self, data: Path, redis_server: running_redis, **settings: Any) -> None:
        _empty(redis_server)
        # Pictures are rendered, not reused from earlier tests, and nothing is rendered that the test has not requested.
        own = {"batch_deadline": 2.0, "reuse_films": False, "idle_posters": False}
        self.options = {"data": data, "redis_url": redis_server.url, "token": TOKEN, **own, **settings}
        if not self.options.get("database_url"):
            place_database(data)
        self.start()

    def start(self) -> None:
        self.port = free_port("127.0.0.1")
        self.url = f"http://127.0.0.1:{self.port}"
        self.app = create_app(Settings(port=self.port, **self.options))
        config = uvicorn.Config(
            self.app, port=self.port, log_level="warning", log_config=None, timeout_graceful_shutdown=2, proxy_headers=False
        )
        self.server = uvicorn.Server(config)
        self.thread = threading.Thread(target=self.server.run, daemon=True)
        self.thread.start()
        until(lambda: self.server.started, "the service starts")
        self.http = httpx.Client(base_url=self.url, timeout=60, verify=False)  # loading certificates is slow

    @property
    def farm(self) -> Farm:
        farm: Farm = self.app.state.farm
        return farm

    def stop(self) -> None:
        self.http.close()
        self.server.should_exit = True
        self.thread.join(15)
        assert not self.thread.is_alive()

    def restart(self) -> None:
        self.stop()
        self.start()

    def worker(self, **options: Any) -> PeerWorker:
        return PeerWorker(self.options["redis_url"], self.url, TOKEN, **options)

    def upload(self, content: bytes = OBJ, name: str = "scene.obj") -> str:
        answer = self.http.post("/api/scenes", files={"files": (name, content)})
        assert answer.status_code == 201, answer.text
        return str(answer.json()["id"])

    def scene(self, id: str) -> dict[str, Any]:
        return self.http.get(f"/api/scenes/{id}").raise_for_status().json()

    def ready_scene(self) -> str:
        id = self.upload()
        until(lambda: self.scene(id)["status"] == "ready", "the scene is prepared")
        return id

    def submit(self, scene: str, **request: Any) -> str:
        request = {"width": 64, "height": 48, "spp": 8, "tile_size": 16, **request}
        answer = self.http.post("/api/jobs", json={"scene": scene, **request})
        assert answer.status_code == 201, answer.text
        return str(answer.json()["id"])

    def job(self, id: str) -> dict[str, Any]:
        return self.http.get(f"/api/jobs/{id}").raise_for_status().json()

    def patch(self, id: str, **change: Any) -> dict[str, Any]:
        return self.http.patch(f"/api/jobs/{id}", json=change).raise_for_status().json()

    def wait_for(self, id: str, state: str, timeout: float = 20.0) -> dict[str, Any]:
        rarely = 0.25 if state in OVER else 0.1  # final states do not change
        until(lambda: self.job(id)["state"] == state, f"job {state}", timeout, lambda: self.job(id), rarely)
        return self.job(id)

    def digest(self, id: str) -> str:
        return str(self.http.get(f"/api/jobs/{id}/frames/0/digest").raise_for_status().json()["digest"])


@functools.cache
def _made_database() -> bytes:
    """Returns the bytes of an SQLite file with a farm's empty tables."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rayfarm.sqlite"
        connect(f"sqlite:///{path}")[0].dispose()
        return path.read_bytes()


def place_database(data: Path) -> None:
    """Copies an SQLite database with a farm's empty tables into a new data folder, which is faster than the migrations."""
    path = data / "rayfarm.sqlite"
    if not path.exists():
        data.mkdir(parents=True, exist_ok=True)
        path.write_bytes(_made_database())


def new_sqlite(folder: Path) -> str:
    """Returns the URL of a new SQLite database with a farm's empty tables."""
    place_database(folder)
    return f"sqlite:///{folder / 'rayfarm.sqlite'}"


def until(
    true: Callable[[], bool], what: str, timeout: float = 20.0, say: Callable[[], Any] = lambda: "", rarely: float = 0.1
) -> None:
    """Waits until the function `true` returns a true value; after `timeout` seconds, raises AssertionError.

    what: describes the condition in the error. say: returns further text for the error. rarely: the longest time between two
    checks in seconds; checks become rarer, since most of them use HTTP and took a fifth of the processor time of such tests.
    """
    deadline = time.monotonic() + timeout
    pause = 0.02
    while not true():
        assert time.monotonic() < deadline, f"waited {timeout} s until {what}: {say()}"
        time.sleep(pause)
        pause = min(1.3 * pause, rarely)


@pytest.fixture(scope="session")
def redis_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[running_redis]:
    server = running_redis(tmp_path_factory.mktemp("redis"))
    server.start()
    yield server
    server.stop()


def _empty(server: running_redis) -> None:
    """Deletes all keys from Redis, such as a stored pause of a worker whose name a later test uses again."""
    with redis.Redis.from_url(server.url) as client:
        client.flushall()


class Databases:
    """Creates databases for the tests of this process, on the database system named `sqlite` or `postgresql`.

    If RAYFARM_TEST_DATABASE_URL is set, all tests use the database at this URL instead.
    """

    def __init__(self) -> None:
        self.given = os.environ.get("RAYFARM_TEST_DATABASE_URL", "")  # a database that may be cleared; if set, all tests use it
        self._server: PostgresServer | None = None

    def server(self) -> PostgresServer:
        """Returns the PostgreSQL server of this process, started at its first use."""
        if self._server is None:
            binaries = find_postgres()
            if binaries is None:
                pytest.skip("PostgreSQL is not installed: this is tested on SQLite alone. On Debian: apt install postgresql")
            self._server = PostgresServer(binaries)
        return self._server

    @contextmanager
    def new(self, name: str) -> Iterator[str]:
        """Yields the URL of an empty farm database, and deletes the database at the end of the `with` block.

        name: `sqlite` or `postgresql`. The URL is '' for SQLite: the service then creates the database in its data folder.
        """
        if self.given:
            empty_database(self.given)
            yield self.given
        elif name == "sqlite":
            yield ""
        else:
            server = self.server()
            url = server.new()
            yield url
            server.drop(url)

    def stop(self) -> None:
        if self._server is not None:
            self._server.stop()


def empty_database(url: str) -> None:
    """Deletes the farm's tables."""
    engine = create_engine(url)
    Base.metadata.drop_all(engine)
    with engine.begin() as connection:
        connection.execute(text("DROP TABLE IF EXISTS alembic_version"))
    engine.dispose()


@pytest.fixture(scope="session")
def databases() -> Iterator[Databases]:
    found = Databases()
    yield found
    found.stop()


@pytest.fixture
def database(request: pytest.FixtureRequest, databases: Databases) -> Iterator[str]:
    """Yields the URL of a database for one test; '' for SQLite in the data folder.

    Tests of the files in ON_BOTH run twice, with SQLite and with PostgreSQL.
    """
    with databases.new(getattr(request, "param", "sqlite")) as url:
        yield url


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    where = metafunc.definition.path.relative_to(Path(__file__).parent).as_posix()
    if "database" in metafunc.fixturenames and where in ON_BOTH and not os.environ.get("RAYFARM_TEST_DATABASE_URL"):
        rare = [] if metafunc.function.__name__.startswith(ON_BOTH[where]) else [pytest.mark.long]
        metafunc.parametrize("database", ["sqlite", pytest.param("postgresql", marks=rare)], indirect=True)


@pytest.fixture
def service(tmp_path: Path, redis_server: running_redis, database: str) -> Iterator[Service]:
    service = Service(tmp_path / "data", redis_server, database_url=database)
    yield service
    service.stop()


@pytest.fixture
def worker(service: Service) -> Iterator[PeerWorker]:
    with service.worker() as worker:
        yield worker
