"""Which process runs which file of tests, where they are spread over several."""

from __future__ import annotations

import os

import pytest
from xdist.remote import Producer
from xdist.scheduler import LoadScopeScheduling
from xdist.workermanage import WorkerController

__all__ = ["SHARE_THE_FARM", "Shares"]

# The files whose tests use `farm` or `browser`. Where the tests are spread over processes one of them runs all of these, so that
# there is one farm, which nobody else disturbs.
SHARE_THE_FARM = (
    "tests/e2e/",
    "tests/chaos/test_kernels.py",
    "tests/rayfarm/test_with_farm.py",
    "tests/rayfarm/library/test_on_farm.py",
)
WAITING = ("tests/service/",)  # two thirds of the time for something that comes within a second
SPREAD_FROM = 4  # processes: with fewer, all of them run whatever is next


class Shares(LoadScopeScheduling):
    """xdist's way with classes, for files: a file's tests run in one process, in the order of the collection.

    The second half of the processes runs only what mostly waits, so that a processor has something to do meanwhile; the first
    half runs all else, which fills it, and what is left of the former. So no more than the first half ever fill the processors:
    what waits for them would run out of patience.

    Its own `loadgroup` writes a mark into a test's id, where pytest 9.1 and later do not look for it.
    """

    def __init__(self, config: pytest.Config, log: Producer | None = None) -> None:
        super().__init__(config, log)
        self._filling = self.numnodes if self.numnodes < SPREAD_FROM else self.numnodes // 2

    def _split_scope(self, nodeid: str) -> str:
        path = nodeid.partition("::")[0]
        if path.startswith(SHARE_THE_FARM):
            return "farm"
        if path.startswith("tests/service/") and "RAYFARM_TEST_DATABASE_URL" in os.environ:
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
        waiting = [scope for scope in self.workqueue if scope.startswith((*WAITING, "database"))]
        if int(node.gateway.id.removeprefix("gw")) >= self._filling:
            return waiting[0] if waiting else None
        if self._filling == self.numnodes:
            return next(iter(self.workqueue))
        return next((scope for scope in self.workqueue if scope not in waiting), waiting[0] if waiting else None)
