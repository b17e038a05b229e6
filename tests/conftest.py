"""Fixtures and plug-ins of all tests: a real Redis, and a whole farm."""

from __future__ import annotations

import atexit
import gc
import os
import re
import shutil
import signal
import sys
from collections.abc import Generator, Iterator
from pathlib import Path

import hypothesis
import pytest
from _pytest.runner import runtestprotocol
from execnet import XSpec
from xdist.remote import Producer
from xdist.scheduler import EachScheduling

from tests.fork_server import ForkServer
from tests.grids import leave_out_long
from tests.helpers import Farm, running_redis, start_farm, stop_farm
from tests.kernels import get_ready, ready_first
from tests.parts import is_in_part, own_part, place

TESTS = Path(__file__).parent

# A shell that starts the tests in the background makes them ignore Ctrl-C, which their child processes would inherit.
signal.signal(signal.SIGINT, signal.default_int_handler)

if "PYTEST_XDIST_WORKER" in os.environ:
    # A process of xdist exits without freeing its million objects one by one, which takes two seconds. First registered, this
    # runs after all other exit handlers.
    atexit.register(os._exit, 0)

# Plain HTTP needs no certificates, which every client would read; this folder has none.
os.environ.setdefault("SSL_CERT_DIR", str(TESTS))

# An example's duration depends more on the machine than on the code. Most false properties fail early.
hypothesis.settings.register_profile("long", deadline=None)
hypothesis.settings.register_profile("ordinary", deadline=None, max_examples=20)
hypothesis.settings.load_profile("long")


def is_ordinary(config: pytest.Config) -> bool:
    """Returns whether this is a default run, which leaves out the tests marked `long`."""
    return bool(config.option.markexpr == "not long")


@pytest.hookimpl(trylast=True)
def pytest_configure(config: pytest.Config) -> None:
    """Prepares a default run: loads hypothesis' profile and omits grids' `long` cells.

    Last, so that its clean-up comes before pytest's, which would collect all objects a second time in search of leaks.
    """
    if "PYTEST_XDIST_WORKER" in os.environ:
        config.add_cleanup(gc.freeze)
    if not is_ordinary(config):
        return
    hypothesis.settings.load_profile("ordinary")
    leave_out_long()


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Skips files of other processes' parts and, in a default run, files whose tests are all marked `long`."""
    if collection_path.is_dir():
        return True if all(is_of_others(path) for path in collection_path.rglob("test_*.py")) else None
    if not (collection_path.name.startswith("test_") and collection_path.suffix == ".py"):
        return None
    if is_of_others(collection_path):
        return True
    return True if is_ordinary(config) and has_only_long(collection_path.read_text(encoding="utf-8")) else None


def is_of_others(path: Path) -> bool:
    """Returns whether another process of xdist runs a test file. Files outside tests/ have no part: each process runs them."""
    return path.is_relative_to(TESTS) and not is_in_part(path_of(path), *own_part())


def path_of(path: Path) -> str:
    """Returns the path below tests/ of a test file in that folder."""
    return path.relative_to(TESTS).as_posix()


def order(path: Path) -> tuple[int, int, str]:
    """Returns the sort key of a test file's tests. Files outside tests/ come first, by path."""
    return (*place(path_of(path)), path_of(path)) if path.is_relative_to(TESTS) else (-1, 0, path.as_posix())


def has_only_long(source: str) -> bool:
    """Returns whether a file is marked `long`, or each of its test functions is. source: the file's text."""
    if re.search(r"^pytestmark = .*\bpytest\.mark\.long\b", source, re.MULTILINE):
        return True
    tests = [part for part in source.split("\n\n\n") if "def test_" in part]  # two empty lines between all functions
    return bool(tests) and all(
        re.search(r"^@pytest\.mark\.long\b", part, re.MULTILINE) and part.count("def test_") == 1 for part in tests
    )


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Disables garbage collection during test collection, since nearly all imported objects stay."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_pycollect_makeitem(collector: pytest.Module | pytest.Class, name: str, obj: object) -> list[pytest.Item] | None:
    """Creates no test items for tests marked `long` in a default run.

    This is faster than creating and then deselecting them, a quarter of all tests.
    """
    if not is_ordinary(collector.config) or not collector.funcnamefilter(name):
        return None
    marks = [*getattr(obj, "pytestmark", ()), *collector.iter_markers()]
    return [] if any(mark.name == "long" for mark in marks) else None


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool | None:
    """Makes a process of xdist report only calls, and what fails or is skipped before or after them.

    Otherwise six messages are sent for each test, whose handling takes a fiftieth of all processor time.
    """
    if "PYTEST_XDIST_WORKER" not in os.environ:
        return None
    for report in runtestprotocol(item, log=False, nextitem=nextitem):
        if report.when == "call" or not report.passed:
            item.ihook.pytest_runtest_logreport(report=report)
    return True


class ByPart(EachScheduling):
    """Scheduler for xdist that lets every process run all that it has collected, which is its part."""

    def schedule(self) -> None:
        """Starts the tests, and sets their number, which otherwise would be that of one part."""
        super().schedule()
        session = self.config.pluginmanager.get_plugin("session")
        assert isinstance(session, pytest.Session)
        session.testscollected = sum(len(collected) for collected in self.node2collection.values())


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_setupnodes(config: pytest.Config, specs: list[XSpec]) -> None:
    """Forks the processes from one that has imported their libraries (tests/fork_server.py), where forks are safe."""
    if sys.platform == "linux":
        server = ForkServer()
        server.use_for(specs)
        config.add_cleanup(server.stop)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> ByPart:
    return ByPart(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Orders the tests, and drops those of others' files that were named on the command line, which no hook ignores."""
    items[:] = [item for item in items if not is_of_others(item.path)]
    items.sort(key=lambda item: order(item.path))


def pytest_collection_finish() -> None:
    """Makes garbage collection rare and exempts all objects that exist after test collection from it.

    With Python's settings it takes a tenth of the tests' time.
    """
    gc.freeze()
    gc.set_threshold(50_000, 20, 100)


def pytest_sessionfinish() -> None:
    gc.unfreeze()  # otherwise the leak check at the end finds false leaks


@pytest.fixture(scope="session", autouse=True)
def kernels(request: pytest.FixtureRequest) -> Iterator[None]:
    """Lets only one process compile each kernel, while the others wait for it and load the result.

    It does nothing if only tests of the service run, which use no kernels.
    """
    if all("service" in item.path.parts for item in request.session.items):
        yield
        return
    with ready_first(is_ordinary(request.config)):
        yield


@pytest.fixture(scope="session")
def redis_url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Yields the URL of a real Redis server, started for this process of the test run."""
    with running_redis(tmp_path_factory.mktemp("redis")) as url:
        yield url


@pytest.fixture(scope="session")
def farm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Farm]:
    """Yields a farm with two slots, shared by all tests of this process; lost batches are repeated after 5 seconds."""
    get_ready("plain")  # otherwise the first picture would also wait for its kernel
    farm = start_farm(tmp_path_factory.mktemp("farm") / "data", 2, module="tests.without_spares", RAYFARM_BATCH_DEADLINE="5")
    yield farm
    stop_farm(farm)


@pytest.fixture(scope="session")
def program() -> str:
    """Returns the path of the program `node` (Node.js); skips the test if there is none."""
    path = shutil.which("node")
    if path is None:
        pytest.skip("no Node.js on the PATH (Debian: apt-get install nodejs)")
    return path


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Turns skipped tests into failures if $CI is set.

    Otherwise a machine without Chromium, for example, would seem to pass the page's tests. Tests marked `hardware` may be
    skipped, since they need a processor that no installation can provide.
    """
    report = yield
    if not item.get_closest_marker("hardware") and not hasattr(report, "wasxfail"):
        refuse_skip_in_ci(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector: pytest.Collector) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """Turns a file that is skipped while it is imported, such as by `pytest.importorskip`, into an error if $CI is set."""
    report = yield
    refuse_skip_in_ci(report)
    return report


def refuse_skip_in_ci(report: pytest.TestReport | pytest.CollectReport) -> None:
    """Makes a report of a skip a failure if $CI is set."""
    if report.skipped and os.environ.get("CI"):
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        report.outcome = "failed"
        report.longrepr = f"{report.nodeid} must not be skipped where $CI is set: {reason}"
