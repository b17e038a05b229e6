"""Fixtures and plug-ins of all tests: a real Redis, and a whole farm."""

from __future__ import annotations

import gc
import os
import re
import shutil
import signal
from collections.abc import Generator, Iterable, Iterator
from pathlib import Path

import hypothesis
import pytest
from xdist.remote import Producer
from xdist.scheduler import LoadFileScheduling

from tests.grids import leave_out_long
from tests.helpers import Farm, running_redis, start_farm, stop_farm
from tests.kernels import get_ready, ready_first

# A shell that starts the tests in the background makes them ignore Ctrl-C, which their child processes would inherit.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Plain HTTP needs no certificates, which every client would read; this folder has none.
os.environ.setdefault("SSL_CERT_DIR", str(Path(__file__).parent))

# Test files in the order in which they start: first those without kernels, while kernels are compiled.
FIRST = (
    "test_",
    "protocol/",
    "telemetry/",
    "service/",
    "renderer/scene/",
    "renderer/test_target",
)

# These start processes and mostly wait for them, so they are spread evenly, in this order, among tests that use the processors.
WAITING = ("worker/", "rayfarm/", "chaos/")

# Files that use `farm` or `browser`. One process runs them all, so that there is one farm and one browser. They start first, in
# this order, since together they take longest. The last one kills processes of the farm.
SHARE_A_FARM = (
    "tests/e2e/",
    "tests/rayfarm/test_with_farm.py",
    "tests/rayfarm/library/test_farm_render.py",
    "tests/rayfarm/datasets/test_dataset_of_farm.py",
    "tests/rayfarm/test_job_template.py",
    "tests/rayfarm/test_mcp_server.py",
    "tests/submitters/test_submitters.py",
    "tests/chaos/test_kernels",
    "tests/chaos/test_digest",
)

# Files that use the module of a graphics card's kernel, or build its tree. One process runs them all and compiles each once.
SHARE_A_CARD = (
    "tests/renderer/bvh/test_compressed.py",
    "tests/renderer/cuda/",
)

# An example's duration depends more on the machine than on the code. Most false properties fail early.
hypothesis.settings.register_profile("long", deadline=None)
hypothesis.settings.register_profile("ordinary", deadline=None, max_examples=20)
hypothesis.settings.load_profile("long")


def is_ordinary(config: pytest.Config) -> bool:
    """Returns whether this is a default run, which leaves out the tests marked `long`."""
    return bool(config.option.markexpr == "not long")


def pytest_configure(config: pytest.Config) -> None:
    """Prepares a default run: loads hypothesis' profile, omits grids' `long` cells, and orders imports.

    Every process of xdist imports every test file, but each begins with a different part of them. In a fresh clone the first
    import of a file rewrites its assertions and caches the result for the other processes, which takes longer than all other
    imports.
    """
    if not is_ordinary(config):
        return
    hypothesis.settings.load_profile("ordinary")
    leave_out_long()
    if config.args == config.getini("testpaths"):
        count = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
        config.args = rotated(int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")), count)


def rotated(process: int, count: int) -> list[str]:
    """Returns the folders and files that process number `process` of `count` collects: all of them, its own part first.

    Folders are named where possible, since pytest lists a folder again for each of its files that is named.
    """
    tests = Path(__file__).parent
    files = [path.relative_to(tests).parts for path in sorted(tests.rglob("test_*.py"))]
    places = [str(tests.joinpath(*parts[: 2 if parts[0] in ("renderer", "service") else 1])) for parts in files]
    names = list(dict.fromkeys(places))
    begin = names.index(places[process * len(places) // count])
    return names[begin:] + names[:begin]


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Skips, in a default run, the import of test files whose tests are all marked `long`.

    These are an eighth of all files, which every process of xdist would import otherwise.
    """
    is_test = collection_path.name.startswith("test_") and collection_path.suffix == ".py"
    return True if is_test and is_ordinary(config) and has_only_long(collection_path.read_text(encoding="utf-8")) else None


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


class ByFile(LoadFileScheduling):
    """Scheduler for xdist that gives all tests of a file to one process, and all files that share something to the same process.

    It is used in place of xdist's `loadgroup`, which fails with pytest 9.1 and later.
    """

    def _split_scope(self, nodeid: str) -> str:
        if nodeid.startswith(SHARE_A_CARD):
            return "card"
        return "farm" if nodeid.startswith(SHARE_A_FARM) else super()._split_scope(nodeid)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> ByFile:
    return ByFile(config, log)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    places = hand_out(dict.fromkeys(item.nodeid.partition("::")[0] for item in items))
    items.sort(key=lambda item: places[item.nodeid.partition("::")[0]])


def hand_out(files: Iterable[str]) -> dict[str, tuple[float, str]]:
    """Returns the sort key of each test file; files are run in the order of their keys.

    Files that share a farm come first; files that mostly wait are spread evenly among the others.
    files: paths below the clone's root.
    """
    groups: dict[str, list[tuple[int, str]]] = {"farm": [], "waiting": [], "busy": []}
    for file in files:
        name = file.removeprefix("tests/")
        group = "farm" if file.startswith(SHARE_A_FARM) else "waiting" if name.startswith(WAITING) else "busy"
        order = {"farm": SHARE_A_FARM, "waiting": WAITING, "busy": FIRST}[group]
        name = file if group == "farm" else name
        rank = next((n for n, prefix in enumerate(order) if name.startswith(prefix)), len(order))
        groups[group].append((rank, file))
    places = {file: (0.0, f"{rank} {file}") for rank, file in groups.pop("farm")}
    for members in groups.values():
        places |= {file: ((n + 1) / len(members), file) for n, (_, file) in enumerate(sorted(members))}
    return places


def pytest_collection_finish() -> None:
    """Exempts all objects that exist after collection from garbage collection, which saves a twentieth of the tests' time."""
    gc.freeze()


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
    must_run = bool(os.environ.get("CI")) and not item.get_closest_marker("hardware")
    if report.skipped and must_run and not hasattr(report, "wasxfail"):
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        report.outcome = "failed"
        report.longrepr = f"{item.nodeid} must not be skipped where $CI is set: {reason}"
    return report
