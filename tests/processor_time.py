"""Which tests take the processor: `pytest -p tests.processor_time ...` ends with a table of files, and of single tests.

Counted are this process and all that it starts, also what lives on, and what Numba compiled in this one. By the clock, tests say
more about what else the machine does. What tests share, a farm or a kernel, is counted with the first that wants it. What killed
processes took may be missing. Linux only.
"""

from __future__ import annotations

import os
import sys
import time
from collections import defaultdict
from collections.abc import Generator
from dataclasses import dataclass

import psutil
import pytest

SHOWN = 40


@dataclass
class Taken:
    """Processor seconds. own: of the tests' process. started: of others. compiled: of the first, by Numba."""

    own: float = 0.0
    started: float = 0.0
    compiled: float = 0.0

    def add(self, own: float, started: float, compiled: float) -> None:
        self.own, self.started, self.compiled = self.own + own, self.started + started, self.compiled + compiled


BEGUN = pytest.StashKey[tuple[float, float, float]]()
_compiled = 0.0  # so far


def _listen() -> None:
    """Counts what is compiled from now on, once Numba is there."""
    from numba.core import event

    class Listener(event.Listener):
        begun: list[float] = []  # noqa: RUF012 - there is one

        def on_start(self, event: event.Event) -> None:
            self.begun.append(time.process_time())

        def on_end(self, event: event.Event) -> None:
            global _compiled
            seconds = time.process_time() - self.begun.pop()
            _compiled += 0.0 if self.begun else seconds

    event.register("numba:compile", Listener())


def _so_far() -> tuple[float, float, float]:
    own = os.times()
    alive = 0.0
    for child in psutil.Process().children(recursive=True):
        try:
            alive += sum(child.cpu_times()[:4])  # with the children that it has reaped
        except psutil.NoSuchProcess:
            continue
    return own.user + own.system, own.children_user + own.children_system + alive, _compiled


def pytest_collection_finish(session: pytest.Session) -> None:
    if "numba" in sys.modules:
        _listen()


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    item.stash[BEGUN] = _so_far()
    return (yield)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if report.when == "teardown":  # a report reaches the process that spreads the tests
        report.user_properties.append(("processor", [b - a for a, b in zip(item.stash[BEGUN], _so_far(), strict=True)]))
    return report


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    files: dict[str, Taken] = defaultdict(Taken)
    tests: dict[str, Taken] = defaultdict(Taken)
    whole = Taken()
    for reports in terminalreporter.stats.values():
        for report in reports:
            for name, value in getattr(report, "user_properties", ()):
                if name == "processor":
                    for taken in (files[report.nodeid.partition("::")[0]], tests[report.nodeid], whole):
                        taken.add(*value)
    terminalreporter.section("processor seconds: of the tests' own processes, of others, of the first by Numba")
    for each in ({"all": whole}, files, tests):
        for name, taken in sorted(each.items(), key=lambda item: -item[1].own - item[1].started)[:SHOWN]:
            terminalreporter.line(f"{taken.own:7.1f} {taken.started:7.1f} {taken.compiled:7.1f}  {name[:120]}")
