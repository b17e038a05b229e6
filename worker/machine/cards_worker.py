"""The second worker of a machine, NAME-gpu, which renders with its graphics cards beside the worker with its cores.

The worker with the cores starts it as a child process and restarts it if it ends. It finds and tests the cards itself, so the
slots with cores do not wait for them.
"""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from typing import IO

from renderer.child_processes import spawn_guard
from renderer.cuda.cards import (
    Cards,
    CardsError,
    cards_from_search,
    chosen_cards,
    reasons_unused,
    search_command,
    unused_card,
)
from renderer.cuda.driver import Card
from renderer.cuda.verdicts import START_KERNELS, failure_of, kernels_with_verdicts
from renderer.sentences import Sentence
from worker.machine.health_file import HEALTH_FILE_VARIABLE

__all__ = ["EXIT_NO_CARDS", "EXIT_REFUSED", "CardsWorker"]

EXIT_REFUSED = 3  # of a worker whose restart does not help
EXIT_NO_CARDS = 4  # of a worker with `--gpu auto` none of whose cards can be used
PAUSES_S = (1.0, 5.0, 30.0, 120.0)  # before restarts, by the number of ends so far
STEADY_S = 300.0  # running time after which earlier ends no longer count
END_S = 8.0

log = logging.getLogger("worker")


class CardsWorker:
    """Searches for graphics cards, and runs the worker that renders with them. Used by the worker's main thread only.

    choice: of `--gpu`: auto, all or numbers. arguments: options of the worker with the cores; name: of the one with the cards.
    fail: called if requested cards cannot be used, after the reason was printed.
    """

    def __init__(self, choice: str, arguments: Sequence[str], name: str, token: str, fail: Callable[[], None]) -> None:
        self._choice = choice
        self._command = [sys.executable, "-m", "worker", *arguments, f"--gpu={choice}", "--paired", f"--name={name}"]
        self._environment = {**os.environ, "RAYFARM_TOKEN": token, HEALTH_FILE_VARIABLE: ""}
        self._fail = fail
        self._search: subprocess.Popen[bytes] | None = None
        self._found: Cards | None = None
        self._cards: list[Card] = []  # those that the second worker uses, if they pass the self-test
        self._process: subprocess.Popen[bytes] | None = None
        self._is_over = False  # True: no further process is started
        self._started, self._start_at, self._ends = 0.0, 0.0, 0

    def unused(self) -> list[str]:
        """Returns a sentence for each graphics card of this machine that is not used."""
        if self._found is None:
            return []
        failures = {card: failure_of(card) for card in self._cards}
        untested = [card for card in self._cards if not failures[card] and not {*START_KERNELS} <= {*kernels_with_verdicts(card)}]
        waits = Sentence("card-not-tested", "its self-test has not ended")
        return [
            *reasons_unused(self._found, self._cards),
            *filter(None, failures.values()),
            *(unused_card(card, waits) for card in untested),
        ]

    def check(self) -> None:
        """Starts, restarts and observes the processes; called every second. Returns at once."""
        if self._is_over or time.monotonic() < self._start_at:
            return
        try:
            self._check()
        except (OSError, subprocess.SubprocessError) as error:  # such as too many processes
            log.warning("the worker with the cards cannot be started (%s); the next try is in %g s", error, PAUSES_S[-1])
            self._start_at = time.monotonic() + PAUSES_S[-1]

    def _check(self) -> None:
        if self._found is None:
            self._look_for_cards()
        elif self._process is None:
            self._process, self._started = _started(self._command, self._environment), time.monotonic()
        elif (code := self._process.poll()) is not None:
            self._process = None
            self._after_end(code)

    def _look_for_cards(self) -> None:
        if self._search is None:
            self._search = _started(search_command(), dict(os.environ), subprocess.PIPE)
        if self._search.poll() is None:  # prints less than a pipe holds
            return
        out, err = self._search.communicate()
        self._found = cards_from_search(self._search.returncode, out.decode(), err.decode(errors="replace"))
        try:
            self._cards, _ = chosen_cards(self._choice, self._found)
        except CardsError as error:
            log.error("%s", error)
            self._is_over = True
            self._fail()
        else:
            self._is_over = not self._cards

    def _after_end(self, code: int) -> None:
        """Decides what follows the end of the second worker."""
        if code in (EXIT_NO_CARDS, EXIT_REFUSED):
            self._is_over = True
            if self._choice != "auto":
                self._fail()
            return
        self._ends = 1 if time.monotonic() - self._started > STEADY_S else self._ends + 1
        pause = PAUSES_S[min(self._ends, len(PAUSES_S)) - 1]
        self._start_at = time.monotonic() + pause
        log.warning("the worker with the cards ended (exit code %d); it starts again in %g s", code, pause)

    def stop(self) -> None:
        """Asks the second worker to end, and returns at once. No process is started from then on."""
        self._is_over = True
        for process in (self._search, self._process):
            if process is not None and process.poll() is None:
                process.terminate()

    def wait(self) -> None:
        """Waits for the end of the processes after `stop`; kills them after END_S seconds."""
        deadline = time.monotonic() + END_S
        for process in (self._search, self._process):
            if process is None:
                continue
            try:
                process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _started(command: list[str], environment: dict[str, str], pipe: int | IO[bytes] | None = None) -> subprocess.Popen[bytes]:
    """Starts a process that ends with this one."""
    return subprocess.Popen(
        command, env=environment, stdin=subprocess.DEVNULL, stdout=pipe, stderr=pipe, preexec_fn=spawn_guard()
    )
