"""What all tests share: a real Redis, and a whole farm."""

from __future__ import annotations

import os
import signal
from collections.abc import Generator, Iterator

import hypothesis
import pytest

from tests.helpers import Farm, running_redis, start_farm, stop_farm

# A shell that starts the tests in the background has them ignore Ctrl-C, and what they start would ignore it too.
signal.signal(signal.SIGINT, signal.default_int_handler)

# How long an example takes says more about the machine than about the code.
hypothesis.settings.register_profile("rayfarm", deadline=None)
hypothesis.settings.load_profile("rayfarm")


@pytest.fixture(scope="session")
def redis_url(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A real Redis server of the tests' own."""
    with running_redis(tmp_path_factory.mktemp("redis")) as url:
        yield url


@pytest.fixture(scope="session")
def farm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Farm]:
    """A farm with two slots that the tests share; those that kill things start their own."""
    made = start_farm(tmp_path_factory.mktemp("farm") / "data", 2)
    yield made
    stop_farm(made)


@pytest.hookimpl(tryfirst=True)  # before xdist looks at the groups
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What runs in one process where the tests are spread over several: all that share the farm or the browser, else a file.

    Those that wait for other processes come first, so that the others fill the time. With pytest 9.2 and xdist 3.8 the groups
    have no effect: xdist writes them into a node's id, and that no longer shows; so every process has a farm of its own.
    """
    for item in items:
        shares = {"farm", "browser"} & set(getattr(item, "fixturenames", ()))
        of_database = (
            "service" in item.path.parts and "RAYFARM_TEST_DATABASE_URL" in os.environ
        )  # there is one, and it is emptied
        name = "farm" if shares else "database" if of_database else str(item.path)
        item.add_marker(pytest.mark.xdist_group(name))
    items.sort(key=lambda item: item.get_closest_marker("farm") is None and item.get_closest_marker("browser") is None)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Where $CI is set nothing is skipped: a machine without Chromium would otherwise call the page tested."""
    report = yield
    if report.skipped and os.environ.get("CI") and not hasattr(report, "wasxfail"):
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        report.outcome = "failed"
        report.longrepr = f"{item.nodeid} must not be skipped where $CI is set: {reason}"
    return report
