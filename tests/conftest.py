"""What all tests share: a real Redis, and a whole farm."""

from __future__ import annotations

import gc
import os
import signal
import socket
from collections.abc import Generator, Iterator
from contextlib import ExitStack
from pathlib import Path

import hypothesis
import pytest
from xdist.remote import Producer
from xdist.workermanage import WorkerController

from tests.helpers import Farm, running_redis, start_farm, stop_farm
from tests.kernels import compiling_beside, ready_first, wait_for_farms
from tests.spreading import SHARE_THE_FARM, WAITING, WITHOUT_A_FARM, Shares, is_left_out, only_what_waits

# A shell that starts the tests in the background has them ignore Ctrl-C, and what they start would ignore it too.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Plain HTTP needs no certificates, and every client reads all that it finds: here there are none.
os.environ.setdefault("SSL_CERT_DIR", str(Path(__file__).parent))

# Begun first, in this order: what needs no kernel while they are compiled, then what takes longest.
FIRST = (
    "tests/test_static.py",
    "tests/service/scheduling/",
    "tests/service/",
    "tests/test_types.py",
    SHARE_THE_FARM,
    "tests/test_packaging.py",
    "tests/chaos/",
    "tests/worker/",
)
GARBAGE = 20_000  # objects that are new when the collector looks for garbage among them; of itself it does so at 700
SHARED = pytest.StashKey[ExitStack]()
COMPILING = pytest.StashKey[ExitStack]()

# How long an example takes says more about the machine than about the code. Most properties that do not hold fail early.
hypothesis.settings.register_profile("long", deadline=None)
hypothesis.settings.register_profile("ordinary", deadline=None, max_examples=20)
hypothesis.settings.load_profile("long")


def pytest_configure(config: pytest.Config) -> None:
    """Before any test is collected: its settings are taken then."""
    if "not long" in config.option.markexpr:
        hypothesis.settings.load_profile("ordinary")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Nothing of what is imported and collected is garbage: it is not looked for meanwhile."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


def pytest_collection_finish() -> None:
    """What is imported and collected stays: the garbage collector need not look at it again and again. And tests make little
    of it: the collector's own pace takes a twentieth of their time.
    """
    gc.freeze()
    gc.set_threshold(GARBAGE)


def pytest_sessionstart(session: pytest.Session) -> None:
    """Where all tests are run, spread over processes, the process that spreads them has another compile their kernels."""
    session.config.stash[COMPILING] = ends = ExitStack()
    _answer_at_once(session.config)
    spreads = bool(getattr(session.config.option, "numprocesses", None)) and not hasattr(session.config, "workerinput")
    if spreads and session.config.args_source is pytest.Config.ArgsSource.TESTPATHS:
        ends.enter_context(compiling_beside())


def _answer_at_once(config: pytest.Config) -> None:
    """pytest-rerunfailures tells the process that spreads the tests of each, and asks it about the next. Unless told otherwise
    the system holds the question back until the news is acknowledged: 40 ms, for thousands of tests that take less than ten.
    """
    told = getattr(getattr(config, "failures_db", None), "sock", None)
    if isinstance(told, socket.socket):
        told.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)


def pytest_sessionfinish(session: pytest.Session) -> None:
    session.config.stash[COMPILING].close()
    gc.unfreeze()  # else what looks for leaks at the very end finds some


@pytest.fixture(scope="session", autouse=True)
def kernels_ready_first(request: pytest.FixtureRequest) -> Iterator[None]:
    if all(item.nodeid.startswith(WAITING) for item in request.session.items):
        yield  # the service knows no kernels
        return
    with ready_first():
        yield


@pytest.fixture(scope="session")
def redis_url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A real Redis server of the tests' own."""
    with running_redis(tmp_path_factory.mktemp("redis")) as url:
        yield url


@pytest.fixture(scope="session")
def shared(request: pytest.FixtureRequest) -> Iterator[ExitStack]:
    """Ends what is put on it after the last test that may use it: a farm is never quite idle."""
    with ExitStack() as ends:
        request.session.stash[SHARED] = ends
        yield ends


@pytest.hookimpl(trylast=True)  # when the test's own fixtures have ended
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    if SHARED in item.session.stash and (nextitem is None or not nextitem.nodeid.startswith(SHARE_THE_FARM)):
        item.session.stash[SHARED].close()


@pytest.fixture(scope="session")
def farm(tmp_path_factory: pytest.TempPathFactory, shared: ExitStack) -> Farm:
    """A farm with two slots that the tests share; those that kill things start their own."""
    wait_for_farms()
    made = start_farm(tmp_path_factory.mktemp("farm") / "data", 2)
    shared.callback(stop_farm, made)
    return made


@pytest.hookimpl(optionalhook=True)  # without -n there is nothing to spread
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> Shares:
    config.option.loadscopereorder = False
    return Shares(config, log)


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node: WorkerController) -> None:
    node.workerinput["waits"] = only_what_waits(node)


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    return is_left_out(collection_path, config) or None


def pytest_collect_directory(path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """Of two processes that collect the same at the same time one begins at the end: what one has compiled the other loads."""
    is_second = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")) % 2 == 1
    return FromTheEnd.from_parent(parent, path=path) if is_second else None


class FromTheEnd(pytest.Dir):
    def collect(self) -> Iterator[pytest.Item | pytest.Collector]:
        yield from reversed(list(super().collect()))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Puts them in order; and nobody starts a second farm unawares."""

    def turn(item: pytest.Item) -> tuple[int, tuple[str, ...]]:
        paths = item.path.parts
        return next((n for n, first in enumerate(FIRST) if item.nodeid.startswith(first)), len(FIRST)), paths

    for item in items:
        if {"farm", "browser"} & set(getattr(item, "fixturenames", ())) and not item.nodeid.startswith(SHARE_THE_FARM):
            raise pytest.UsageError(f"{item.nodeid} uses the farm or the browser: name its file in tests/spreading.py")
        if "farm" in getattr(item, "fixturenames", ()) and item.nodeid.startswith(WITHOUT_A_FARM):
            raise pytest.UsageError(f"{item.nodeid} uses the farm: its file is not among WITHOUT_A_FARM of tests/spreading.py")
    items.sort(key=turn)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Fails a skipped test where $CI is set, since a machine without Chromium would otherwise pass the page's tests.

    Tests marked `hardware` need a processor that no installation provides, and are skipped there too.
    """
    report = yield
    must_run = bool(os.environ.get("CI")) and not item.get_closest_marker("hardware")
    if report.skipped and must_run and not hasattr(report, "wasxfail"):
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        report.outcome = "failed"
        report.longrepr = f"{item.nodeid} must not be skipped where $CI is set: {reason}"
    return report
