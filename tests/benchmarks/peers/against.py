"""Row `samples` of the comparison, with another commit of Rayfarm in place of Mitsuba.

Both commits render in turn, over many short rounds; their processor times are compared.
"""

from __future__ import annotations

import contextlib
import statistics
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from tests.benchmarks.peers.measure import Line, Taken, race, ratio_line
from tests.benchmarks.peers.scenes import CASES
from tests.benchmarks.peers.sizes import Sizes
from tests.helpers import ROOT

__all__ = ["against_lines"]

_SCRIPT = Path(__file__).with_name("one_side.py")


class _Side:
    """A process that renders one scene on request, with the code of one commit's working tree."""

    def __init__(self, tree: Path, name: str, size: str, spp: int) -> None:
        command = [sys.executable, str(_SCRIPT), name, size, str(spp)]
        self._process = subprocess.Popen(command, cwd=tree, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        if self._answer() != "ready":
            raise RuntimeError(f"the renderer of {tree} cannot render {name}: see above")

    def _answer(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()

    def render(self, seed: int) -> Taken:
        """Requests one render with this seed, and returns its processor time.

        It is returned in place of the wall time too, since other work of the machine affects it less.
        """
        assert self._process.stdin is not None
        self._process.stdin.write(f"{seed}\n")
        self._process.stdin.flush()
        seconds = float(self._answer())
        return Taken(seconds, seconds)

    def close(self) -> None:
        """Ends the process."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait()


@contextlib.contextmanager
def _working_tree(commit: str, folder: Path) -> Iterator[Path]:
    """Checks out a commit below a temporary folder during the `with` block."""
    tree = folder / "against"
    subprocess.run(["git", "worktree", "add", "--quiet", "--detach", str(tree), commit], cwd=ROOT, check=True)
    try:
        yield tree
    finally:
        subprocess.run(["git", "worktree", "remove", "--force", str(tree)], cwd=ROOT, check=True)


def against_lines(sizes: Sizes, folder: Path, commit: str, quick: bool, rounds: int, spp: int) -> Iterator[Line]:
    """Compares this working tree with another commit, scene by scene; yields one line per scene.

    A line's value is the commit's time divided by ours, the median over the rounds.
    """
    size = "quick" if quick else "full"
    with _working_tree(commit, folder) as tree:
        for name in CASES:
            if not sizes.wants(name):
                continue
            ours, theirs = _Side(ROOT, name, size, spp), _Side(tree, name, size, spp)
            try:
                run = race(ours.render, theirs.render, rounds)
            finally:
                ours.close()
                theirs.close()
            total = sizes.picture**2 * spp / 1e6
            rates = [[total / seconds for seconds in side] for side in run.seconds]
            spread = statistics.quantiles(run.ratios, n=4) if rounds > 1 else run.ratios * 3
            yield ratio_line("against", name, run.ratios, "M samples/s", *rates, best=run.cpu_ratio, quartiles=spread)
