"""The end of a worker's log, written by the parent and all slots: they append to an unlinked file, which the parent reads."""

from __future__ import annotations

import contextlib
import fcntl
import logging
import os
import tempfile

__all__ = ["LogTail"]

BYTES_READ = 1 << 16  # bytes that are read
MAX_FILE_BYTES = 1 << 20  # bytes; then all but the last of it is dropped
MAX_LINE_BYTES = 2000  # bytes of a line


class LogTail(logging.Handler):
    """Log handler that appends to an unlinked file. Created by the parent before it forks.

    Each line is written by one call at the file's end, so processes need no lock.
    """

    def __init__(self) -> None:
        super().__init__()
        self._file = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115 - it stays open
        fd = self._file.fileno()
        fcntl.fcntl(fd, fcntl.F_SETFL, fcntl.fcntl(fd, fcntl.F_GETFL) | os.O_APPEND)

    def emit(self, record: logging.LogRecord) -> None:
        """Appends a line. A full disk is ignored."""
        with contextlib.suppress(OSError, ValueError):
            self._file.write(self.format(record).encode(errors="replace")[:MAX_LINE_BYTES] + b"\n")

    def lines(self, max_lines: int = 200) -> list[str]:
        """Returns the last lines, at most `max_lines`, oldest first."""
        with contextlib.suppress(OSError, ValueError):
            text = self._last_bytes().decode(errors="replace")
            return text.splitlines()[-max_lines:]
        return []

    def trim(self) -> None:
        """Removes old lines from the file. Called only in the parent."""
        with contextlib.suppress(OSError, ValueError):
            if os.fstat(self._file.fileno()).st_size > MAX_FILE_BYTES:
                kept = self._last_bytes()
                os.ftruncate(self._file.fileno(), 0)
                self._file.write(kept)

    def close(self) -> None:
        """Closes the file."""
        self._file.close()
        super().close()

    def _last_bytes(self) -> bytes:
        fd = self._file.fileno()
        size = os.fstat(fd).st_size
        data = os.pread(fd, BYTES_READ, max(0, size - BYTES_READ))
        return data if size <= BYTES_READ else data.partition(b"\n")[2]
