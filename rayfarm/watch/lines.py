"""Prints a job's progress line by line, for a pipe, a file or a log."""

from __future__ import annotations

import sys
import threading
import time

from rayfarm.watch.live import LiveJob
from rayfarm.watch.words import frame_title, progress_text
from renderer.printable import one_line

__all__ = ["print_progress"]

EVERY_S = 5.0
LOOK_S = 1.0


def print_progress(live: LiveJob, news: threading.Event) -> None:
    """Prints a line when the state changes, and every few seconds, until the job ends. Raises ClientError."""
    shown_at, shown = 0.0, ("", "")
    while True:
        if live.error is not None:
            raise live.error
        job, now = live.job, time.monotonic()
        state = (job.state, job.message or "")
        if state != shown or now - shown_at >= EVERY_S:
            shown_at, shown = now, state
            line = f"{frame_title(job, live.watched_frame)} · {progress_text(job)}"
            print(one_line(line), flush=True)
        if job.is_over:
            sys.stdout.flush()
            return
        news.wait(LOOK_S)
        news.clear()
