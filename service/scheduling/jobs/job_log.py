"""A job's log: a text file of limited size in a folder next to the films, preserved over restarts.

Dispatched and returned batches are counted, and the counts are written once a second.
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
from service.store.atomic_files import PRIVATE, PRIVATE_FOLDER, write_atomically
from telemetry.log_lines import ids

__all__ = ["KEPT_BYTES", "JobLog", "JobLogs"]

KEPT_BYTES = 1 << 18  # bytes that `text` returns
MAX_FILE_BYTES = 2 * KEPT_BYTES  # bytes of a file; then only the last `KEPT_BYTES` bytes are kept
MAX_LINE_LENGTH = 1000  # characters per line
MAX_PENDING_LINES = 2000  # pending lines while the disk accepts none; the oldest are dropped
FLUSH_EVERY_S = 1.0
COUNTS_EVERY_S = 60.0  # between two counts of a job's batches in the service's log

_service_log = logging.getLogger(__name__)


class JobLog:
    """The lines of one job's log that are not written to its file yet. Used by the engine's thread."""

    def __init__(self) -> None:
        self._lines: list[str] = []
        self.counts: set[str] = set()  # pending lines that count batches
        self._dispatched = 0
        self._back: dict[str, list[float]] = {}  # by worker: batches, samples, seconds

    def add_line(self, text: str, details: str = "") -> None:
        """Adds a line. details: further lines, indented below it."""
        self._add_counts()
        self._add(text)
        for line in details.splitlines():
            self._add(f"    {line}")

    def count_dispatched(self, batches: int) -> None:
        """Adds to the number of dispatched batches, which is logged with the next lines."""
        self._dispatched += batches

    def count_returned(self, worker: str, samples: int, seconds: float) -> None:
        """Counts a returned batch of a worker. samples: over all pixels. seconds: rendering time."""
        counts = self._back.setdefault(worker, [0, 0, 0.0])
        counts[0] += 1
        counts[1] += samples
        counts[2] += seconds

    def drain(self) -> str:
        """Returns the pending lines and removes them."""
        self._add_counts()
        lines, self._lines = self._lines, []
        return "".join(f"{line}\n" for line in lines)

    def _add_counts(self) -> None:
        if self._dispatched:
            self.counts.add(self._add(f"handed out: {_batches(self._dispatched)}"))
            self._dispatched = 0
        for worker, (batches, samples, seconds) in self._back.items():
            said = f"back from {worker}: {_batches(int(batches))}, {int(samples):,} samples in {seconds:.2f} s of its slots"
            self.counts.add(self._add(said))
        self._back.clear()

    def _add(self, text: str) -> str:
        now = datetime.fromtimestamp(time.time(), UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        self._lines.append(f"{now} {one_line(text[:MAX_LINE_LENGTH])}")
        if len(self._lines) > MAX_PENDING_LINES:
            del self._lines[: -MAX_PENDING_LINES // 2]
        return self._lines[-1]


class JobLogs:
    """The log files of all jobs. Written by the engine's thread; any thread may read them."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._logs: dict[str, JobLog] = {}
        self._flushed = 0.0
        self._counted: dict[str, float] = {}  # by job: when its counts were last logged at the level info
        self.tiles = TileLogs()

    def log_of(self, job: str) -> JobLog:
        """Returns a job's log, to which lines can be added."""
        return self._logs.setdefault(job, JobLog())

    def flush(self, now: bool = True) -> None:
        """Writes pending lines to the files. Lines that cannot be written are dropped.

        now: False to write at most once a second.
        """
        if not now and time.monotonic() - self._flushed < FLUSH_EVERY_S:
            return
        self._flushed = time.monotonic()
        for job, log in list(self._logs.items()):
            text = log.drain()
            if text:
                self._log_to_service(job, text.splitlines(), log.counts)
                log.counts.clear()
                with contextlib.suppress(OSError):
                    self._append(self._path(job), text.encode(errors="replace"))

    def _log_to_service(self, job: str, lines: list[str], counts: set[str]) -> None:
        """Writes a job's lines to the service's log.

        counts: the lines that count batches. They have the level info at most once a minute, and otherwise the level debug.
        """
        is_due = time.monotonic() - self._counted.get(job, -COUNTS_EVERY_S) >= COUNTS_EVERY_S
        if is_due and not counts.isdisjoint(lines):
            self._counted[job] = time.monotonic()
        for line in lines:
            level = logging.DEBUG if line in counts and not is_due else logging.INFO
            _service_log.log(level, "%s", line.partition(" ")[2], extra=ids(job=job))

    def close(self, job: str) -> None:
        """Writes the pending lines of an ended job and frees its memory."""
        self.flush()
        self._logs.pop(job, None)
        self._counted.pop(job, None)

    def text(self, job: str) -> bytes:
        """Returns the last `KEPT_BYTES` bytes of a job's log, as whole lines; empty if there is no log. Thread-safe."""
        with contextlib.suppress(OSError), self._path(job).open("rb") as file:
            return _last_bytes(file.fileno())
        return b""

    def delete(self, job: str) -> None:
        """Deletes the log of a deleted job."""
        self._logs.pop(job, None)
        self.tiles.remove_job(job)
        with contextlib.suppress(OSError):
            self._path(job).unlink()

    def sweep(self, keep: set[str]) -> None:
        """Deletes the logs of all jobs except those in `keep`."""
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
        if size > MAX_FILE_BYTES:
            kept = self.text(path.stem)
            write_atomically(path, kept)


def _batches(count: int) -> str:
    return f"{count} batch{'es' * (count != 1)}"


def _last_bytes(fd: int) -> bytes:
    size = os.fstat(fd).st_size
    data = os.pread(fd, KEPT_BYTES, max(0, size - KEPT_BYTES))
    return data if size <= KEPT_BYTES else data.partition(b"\n")[2]
