"""Which process runs which file of tests, where they are spread over several."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from xdist.remote import Producer
from xdist.scheduler import LoadScopeScheduling
from xdist.workermanage import WorkerController

__all__ = ["SHARE_THE_FARM", "WAITING", "WITHOUT_A_FARM", "Shares", "is_left_out", "only_what_waits"]

# The files whose tests use `farm` or `browser`. Where the tests are spread over processes one of them runs all that use the farm,
# so that there is one, which nobody else disturbs.
SHARE_THE_FARM = (
    "tests/e2e/",
    "tests/chaos/test_kernels.py",
    "tests/rayfarm/test_with_farm.py",
    "tests/rayfarm/library/test_on_farm.py",
)
# Of these, the files whose tests use the browser alone: another process may run them, with a browser of its own.
WITHOUT_A_FARM = tuple(
    f"tests/e2e/test_{name}.py"
    for name in (
        "again",
        "assets",
        "jobs",
        "login",
        "machines",
        "modules",
        "projects",
        "queue",
        "queue_form",
        "said",
        "scene_grid",
        "settings_form",
        "shot_form",
    )
)
WAITING = "tests/service/"  # two thirds of the time for something that comes within a second
SPREAD_FROM = 4  # processes: with fewer, all of them run whatever is next
FILLING = 2  # of so many processes one fills a processor


def filling(processes: int) -> int:
    """How many of the processes run what fills a processor; all others only what mostly waits."""
    return processes if processes < SPREAD_FROM else max(2, processes // FILLING)


def only_what_waits(node: WorkerController) -> bool:
    """Whether a process needs to collect nothing else, which takes it a third of the time: where all tests are run.

    One that comes in place of a process that crashed collects everything.
    """
    processes = node.workerinput["workercount"]
    everything = node.config.args_source is pytest.Config.ArgsSource.TESTPATHS
    return everything and filling(processes) <= _number(node) < processes


def is_left_out(path: Path, config: pytest.Config) -> bool:
    """Whether this process does not collect a path."""
    kept = config.rootpath / WAITING
    return bool(getattr(config, "workerinput", {}).get("waits")) and not (path.is_relative_to(kept) or kept.is_relative_to(path))


class Shares(LoadScopeScheduling):
    """xdist's way with classes, for files: a file's tests run in one process, in the order of the collection.

    The first processes, as many as there are processors, run what fills one, and then what is left of the rest. The others run
    only what mostly waits, so that a processor has something to do meanwhile. No more ever fill the processors: what waits for
    them would run out of patience.

    Its own `loadgroup` writes a mark into a test's id, where pytest 9.1 and later do not look for it.
    """

    def __init__(self, config: pytest.Config, log: Producer | None = None) -> None:
        super().__init__(config, log)
        self._filling = filling(self.numnodes)

    def schedule(self) -> None:
        """As xdist does, also where some processes have collected a part of the tests."""
        first = self.collection is None
        super().schedule()
        session = self.config.pluginmanager.get_plugin("session")
        if first and session is not None:
            session.testscollected = len(self.collection or ())  # and not what the last process has

    def _check_nodes_have_same_collection(self) -> bool:
        """Also puts a whole collection first: that is the one which xdist goes through."""
        collected = self.registered_collections
        parts = {node: found for node, found in collected.items() if node.workerinput.get("waits")}
        whole = {node: found for node, found in collected.items() if node not in parts}
        waiting = [test for test in next(iter(whole.values())) if test.startswith(WAITING)]
        self.registered_collections = whole if all(found == waiting for found in parts.values()) else collected
        try:
            return super()._check_nodes_have_same_collection()
        finally:
            self.registered_collections = {**whole, **parts}

    def _split_scope(self, nodeid: str) -> str:
        path = nodeid.partition("::")[0]
        if path.startswith(WITHOUT_A_FARM):
            return "browser"
        if path.startswith(SHARE_THE_FARM):
            return "farm"
        if path.startswith(WAITING) and "RAYFARM_TEST_DATABASE_URL" in os.environ:
            return "database"  # there is one, and it is emptied
        return path

    def _assign_work_unit(self, node: WorkerController) -> None:
        """xdist takes the queue's first: that is the next one for this process."""
        scope = self._next(node)
        if scope is None:
            node.shutdown()
            return
        self.workqueue.move_to_end(scope, last=False)
        super()._assign_work_unit(node)

    def _next(self, node: WorkerController) -> str | None:
        waiting = [scope for scope in self.workqueue if scope.startswith((WAITING, "database"))]
        if self._filling <= _number(node) < self.numnodes:  # beyond: in the place of one that crashed, whose tests are left
            return waiting[0] if waiting else None
        if self._filling == self.numnodes:
            return next(iter(self.workqueue))
        return next((scope for scope in self.workqueue if scope not in waiting), waiting[0] if waiting else None)


def _number(node: WorkerController) -> int:
    return int(node.gateway.id.removeprefix("gw"))
