"""Fixtures and plug-ins of all tests: a real Redis, and a whole farm."""

from __future__ import annotations

import gc
import os
import shutil
import signal
from collections.abc import Generator, Iterator
from pathlib import Path

import hypothesis
import pytest

from tests.grids import leave_out_long
from tests.helpers import Farm, running_redis, start_farm, stop_farm
from tests.kernels import get_ready, ready_first

# A shell that starts the tests in the background has them ignore Ctrl-C, and what they start would ignore it too.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Plain HTTP needs no certificates, and every client reads all that it finds: here there are none.
os.environ.setdefault("SSL_CERT_DIR", str(Path(__file__).parent))

TESTS = Path(__file__).parent

# Folders of the parts that the whole test command runs in processes of their own; files beside these folders belong to the first.
PARTS = (
    ("service", "protocol", "telemetry", "blender", "benchmarks", "page"),
    ("renderer", "lineage", "peers"),
    ("worker", "chaos", "e2e", "rayfarm"),
)

# Run first, in this order: tests that need no kernel, while kernels are compiled, then those that take longest.
FIRST = (
    "test_",
    "protocol/",
    "telemetry/",
    "service/",
    "worker/",
    "renderer/scene/",
    "chaos/",
    "e2e/",
    "rayfarm/",
    "renderer/test_target",
)

# The files that use `farm` or `browser`: one process runs them all, so that one farm and one browser start.
SHARE_A_FARM = ("e2e/", "rayfarm/test_with_farm.py", "rayfarm/library/test_farm_render.py", "chaos/test_kernels")

# How long an example takes says more about the machine than about the code. Most properties that do not hold fail early.
hypothesis.settings.register_profile("long", deadline=None)
hypothesis.settings.register_profile("ordinary", deadline=None, max_examples=20)
hypothesis.settings.load_profile("long")


def is_ordinary(config: pytest.Config) -> bool:
    """Whether tests marked `long` are excluded."""
    return bool(config.option.markexpr == "not long")


def share_of(process: int, count: int) -> list[str]:
    """Returns the files that one process of the whole test command collects, of `count`, a multiple of the parts' number.

    A process imports and collects only its own files: this took a minute of processor time when each collected all of them.
    """
    part, turn = process % len(PARTS), process // len(PARTS)
    shared, others = [], []
    for file in sorted(TESTS.rglob("test_*.py")):
        path = file.relative_to(TESTS).as_posix()
        if next((n for n, folders in enumerate(PARTS) if path.startswith(tuple(f"{each}/" for each in folders))), 0) == part:
            (shared if path.startswith(SHARE_A_FARM) else others).append(str(file))
    return [*(shared if turn == 0 else ()), *others[turn :: count // len(PARTS)]]


def pytest_configure(config: pytest.Config) -> None:
    """Loads hypothesis' profile before collection, and restricts each process of `--dist each` to its share of the files."""
    if is_ordinary(config):
        hypothesis.settings.load_profile("ordinary")
        leave_out_long()
    if config.option.dist == "each" and "PYTEST_XDIST_WORKER" in os.environ:
        process = int(os.environ["PYTEST_XDIST_WORKER"].removeprefix("gw"))
        config.args = share_of(process, int(os.environ["PYTEST_XDIST_WORKER_COUNT"]))


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Collects no garbage meanwhile: nearly all that is imported stays."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


@pytest.hookimpl(tryfirst=True)
def pytest_pycollect_makeitem(collector: pytest.Module | pytest.Class, name: str, obj: object) -> list[pytest.Item] | None:
    """Creates no items for tests marked `long` in an ordinary run, which is faster than deselecting a quarter of all tests."""
    if not is_ordinary(collector.config) or not collector.funcnamefilter(name):
        return None
    marks = [*getattr(obj, "pytestmark", ()), *collector.iter_markers()]
    return [] if any(mark.name == "long" for mark in marks) else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    def rank(item: pytest.Item) -> tuple[int, str]:
        return next((n for n, name in enumerate(FIRST) if item.nodeid.startswith(f"tests/{name}")), len(FIRST)), str(item.path)

    items.sort(key=rank)


def pytest_collection_finish() -> None:
    """Freezes imported and collected objects for the garbage collector, which saves a twentieth of the tests' time."""
    gc.freeze()


def pytest_sessionfinish() -> None:
    gc.unfreeze()  # else what looks for leaks at the very end finds some


@pytest.fixture(scope="session", autouse=True)
def kernels(request: pytest.FixtureRequest) -> Iterator[None]:
    """Ensures that each kernel is compiled by one process. The service has none."""
    if all("service" in item.path.parts for item in request.session.items):
        yield
        return
    with ready_first(is_ordinary(request.config)):
        yield


@pytest.fixture(scope="session")
def redis_url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The URL of a real Redis server of the test run."""
    with running_redis(tmp_path_factory.mktemp("redis")) as url:
        yield url


@pytest.fixture(scope="session")
def farm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Farm]:
    """A farm with two slots, shared by the tests of a process; tests that kill processes start their own."""
    get_ready("plain")  # else who waits for a picture waits for its kernel too
    farm = start_farm(tmp_path_factory.mktemp("farm") / "data", 2)
    yield farm
    stop_farm(farm)


@pytest.fixture(scope="session")
def program() -> str:
    """Node.js; the test is skipped if there is none."""
    path = shutil.which("node")
    if path is None:
        pytest.skip("no Node.js on the PATH (Debian: apt-get install nodejs)")
    return path


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Fails skipped tests if $CI is set, since a machine without Chromium would otherwise pass the page's tests.

    Tests marked `hardware`, which need a processor that no installation can provide, are skipped there too.
    """
    report = yield
    must_run = bool(os.environ.get("CI")) and not item.get_closest_marker("hardware")
    if report.skipped and must_run and not hasattr(report, "wasxfail"):
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        report.outcome = "failed"
        report.longrepr = f"{item.nodeid} must not be skipped where $CI is set: {reason}"
    return report
