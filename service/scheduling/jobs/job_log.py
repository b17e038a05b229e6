"""A job's log: one text file each beside the films, of bounded size, which outlives the service.

Batches that were handed out and came back are only counted as they pass, and written down once a second.
"""

from __future__ import annotations

import contextlib
import logging
import os
import time
from datetime import UTC, datetime
from pathlib import Path

from renderer.printable import one_line
from service.scheduling.jobs.tile_log import TileLogs
from service.store.atomic_files import PRIVATE, PRIVATE_FOLDER, write_whole
from telemetry.log_lines import ids

__all__ = ["KEPT", "JobLog", "JobLogs"]

KEPT = 1 << 18  # bytes that are told
LARGEST = 2 * KEPT  # bytes of a file; then all but the last of it is dropped
LONGEST = 1000  # characters of a line
MOST_LINES = 2000  # that wait for a disk which takes none; the oldest go
FLUSH_EVERY_S = 1.0

_service_log = logging.getLogger(__name__)


class JobLog:
    """The lines of one job that are not in its file yet; the engine's thread writes."""

    def __init__(self) -> None:
        self._lines: list[str] = []
        self._given = 0
        self._back: dict[str, list[float]] = {}  # of a worker: batches, samples, seconds

    def say(self, text: str, more: str = "") -> None:
        """A line, and more that stands below it, further in."""
        self._tell_counts()
        self._add(text)
        for line in more.splitlines():
            self._add(f"    {line}")

    def given(self, batches: int) -> None:
        """Batches are handed out."""
        self._given += batches

    def back(self, worker: str, samples: int, seconds: float) -> None:
        """A batch came back."""
        counts = self._back.setdefault(worker, [0, 0, 0.0])
        counts[0] += 1
        counts[1] += samples
        counts[2] += seconds

    def take(self) -> str:
        """What is new, and not told any more."""
        self._tell_counts()
        lines, self._lines = self._lines, []
        return "".join(f"{line}\n" for line in lines)

    def _tell_counts(self) -> None:
        if self._given:
            self._add(f"handed out: {_batches(self._given)}")
            self._given = 0
        for worker, (batches, samples, seconds) in self._back.items():
            self._add(f"back from {worker}: {_batches(int(batches))}, {int(samples):,} samples in {seconds:.2f} s of its slots")
        self._back.clear()

    def _add(self, text: str) -> None:
        now = datetime.fromtimestamp(time.time(), UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        self._lines.append(f"{now} {one_line(text[:LONGEST])}")
        if len(self._lines) > MOST_LINES:
            del self._lines[: -MOST_LINES // 2]


class JobLogs:
    """The files, in a folder of their own. The engine's thread writes; any may read."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._logs: dict[str, JobLog] = {}
        self._flushed = 0.0
        self.tiles = TileLogs()

    def of(self, job: str) -> JobLog:
        """A job's log, to be told to."""
        return self._logs.setdefault(job, JobLog())

    def flush(self, now: bool = True) -> None:
        """Write down what is new; now: else only where the last time is a second ago. What no disk takes is lost."""
        if not now and time.monotonic() - self._flushed < FLUSH_EVERY_S:
            return
        self._flushed = time.monotonic()
        for job, log in list(self._logs.items()):
            text = log.take()
            if text:
                if _service_log.isEnabledFor(logging.INFO):
                    for line in text.splitlines():
                        _service_log.info("%s", line.partition(" ")[2], extra=ids(job=job))
                with contextlib.suppress(OSError):
                    self._append(self._path(job), text.encode(errors="replace"))

    def close(self, job: str) -> None:
        """It is over: write down what is new, and keep nothing of it in memory."""
        self.flush()
        self._logs.pop(job, None)

    def text(self, job: str) -> bytes:
        """The newest KEPT bytes of a job's log, whole lines; from any thread. Nothing where there is none."""
        with contextlib.suppress(OSError), self._path(job).open("rb") as file:
            return _end(file.fileno())
        return b""

    def delete(self, job: str) -> None:
        """The job is deleted."""
        self._logs.pop(job, None)
        self.tiles.forget(job)
        with contextlib.suppress(OSError):
            self._path(job).unlink()

    def sweep(self, keep: set[str]) -> None:
        """Remove the logs of all other jobs."""
        with contextlib.suppress(OSError):
            for path in self._folder.glob("*.log"):
                if path.stem not in keep:
                    path.unlink(missing_ok=True)

    def _path(self, job: str) -> Path:
        return self._folder / f"{job}.log"

    def _append(self, path: Path, text: bytes) -> None:
        self._folder.mkdir(mode=PRIVATE_FOLDER, exist_ok=True)
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, PRIVATE), "ab") as file:
            file.write(text)
            size = file.tell()
        if size > LARGEST:
            kept = self.text(path.stem)
            write_whole(path, kept)


def _batches(count: int) -> str:
    return f"{count} batch{'es' * (count != 1)}"


def _end(fd: int) -> bytes:
    size = os.fstat(fd).st_size
    data = os.pread(fd, KEPT, max(0, size - KEPT))
    return data if size <= KEPT else data.partition(b"\n")[2]
