"""Notifies hooks of every job that ends or is late, at least once, even across restarts.

Messages are stored as database rows until they are sent. A row is identified by (hook, job, time of the event), so each event is
reported once; a job that is continued and ends again is a new event.
"""

from __future__ import annotations

import logging
import threading
import time
import uuid

from sqlalchemy import delete, exists, func, or_, select

from service.errors import FarmError
from service.events import Events, WorkerQuarantined
from service.hooks.deliver import RefusedError, UndeliveredError, post, redacted_hook, run_program
from service.hooks.message import job_message, quarantine_message
from service.settings import Settings
from service.store.database import Sessions
from service.store.models import ACTIVE_STATES, FINAL_STATES, Delivery, Job

__all__ = ["RETRIES_S", "Outbox"]

log = logging.getLogger(__name__)

POLL_EVERY_S = 1.0
OVERLAP_S = 60.0  # seconds; rows may be committed in another order than their times
AT_A_TIME = 100
STOP_TIMEOUT_S = 2.0
MAX_HOOK_PAUSE_S = 60.0  # seconds that a hook which does not respond is left alone at most
KEEP_DELIVERED_S = 30 * 86400.0
RETRIES_S = (5.0, 30.0, 120.0, 600.0, 3600.0, 6 * 3600.0, 12 * 3600.0)  # delay in seconds after each failed attempt


class Outbox:
    """Finds ended and late jobs, and sends messages about them to the hooks.

    Each hook has a thread of its own, so a slow hook does not delay others.
    """

    def __init__(self, settings: Settings, sessions: Sessions, events: Events) -> None:
        self._settings = settings
        self._sessions = sessions
        self.hooks = list(dict.fromkeys([*settings.webhooks, *([settings.job_hook] if settings.job_hook else [])]))
        self._since: dict[str, float] = {}
        events.subscribe(WorkerQuarantined, self._queue_quarantine_messages, in_background=True)
        self._rests: dict[str, float] = {}  # hooks that did not respond, and when they are tried again (time.monotonic)
        self._stop = threading.Event()
        self._threads = [threading.Thread(target=self._run, args=[hook], name="hooks", daemon=True) for hook in self.hooks]

    def start(self) -> None:
        """Starts the threads of all hooks."""
        for thread in self._threads:
            thread.start()

    def stop(self) -> None:
        """Stops the threads, each after the message that it is sending.

        Waits at most STOP_TIMEOUT_S seconds for them. Other due messages are sent after the next start.
        """
        self._stop.set()
        until = time.monotonic() + STOP_TIMEOUT_S
        for thread in self._threads:
            if thread.is_alive():
                thread.join(max(until - time.monotonic(), 0.0))

    def send_now(self, hook: str, id: str, message: dict[str, object]) -> None:
        """Sends one message to a hook immediately. Raises UndeliveredError."""
        if hook == self._settings.job_hook:
            run_program(hook, id, message)
        else:
            post(hook, self._settings.webhook_secret, id, message)

    def _queue_quarantine_messages(self, event: WorkerQuarantined) -> None:
        """Queues messages about a quarantined worker to all webhooks. The notification program is run for jobs only."""
        if event.details is None:
            return
        now = time.time()
        job, message = f"worker:{event.worker}"[:40], quarantine_message(now, event.details)
        rows = [
            Delivery(id=f"msg_{uuid.uuid4().hex}", hook=hook, job=job, ended=now, message=message, due=now)
            for hook in self._settings.webhooks
        ]
        if rows:
            with self._sessions.begin() as session:
                session.add_all(rows)

    def _run(self, hook: str) -> None:
        while not self._stop.wait(POLL_EVERY_S):
            try:
                self._record_ended_jobs(hook)
                self._send_due(hook)
            except FarmError as error:
                log.warning("hooks wait: %s", error)
            except Exception:
                log.exception("unexpected error while hooks were notified")

    def _record_ended_jobs(self, hook: str) -> None:
        since = self._since.get(hook)
        if since is None:
            since = self._last_recorded(hook)
        with self._sessions() as session:
            first = select(func.min(Delivery.ended)).where(Delivery.hook == hook, Delivery.job == "")
            begun = session.scalar(first) or 0.0
            after, now = max(begun, since - OVERLAP_S), time.time()
            if after > now:  # the clock was set back: what was sent before is found by its row
                after = now - OVERLAP_S
            is_delivered = exists().where(Delivery.hook == hook, Delivery.job == Job.id, Delivery.ended == Job.finished)
            query = select(Job).where(Job.finished >= after, Job.state.in_(FINAL_STATES), ~is_delivered)
            ended = list(session.scalars(query.order_by(Job.finished).limit(AT_A_TIME)))
            is_delivered = exists().where(Delivery.hook == hook, Delivery.job == Job.id, Delivery.ended == Job.late)
            query = select(Job).where(Job.late >= after, Job.state.in_(ACTIVE_STATES), ~is_delivered)
            late = list(session.scalars(query.order_by(Job.late).limit(AT_A_TIME)))
        if news := ended + late:
            with self._sessions.begin() as session:
                session.add_all(self._row(hook, job) for job in news)
            left = [
                _event_time(some[-1]) for some in (ended, late) if len(some) == AT_A_TIME
            ]  # there may be more events after these
            since = min(left, default=max(map(_event_time, news)))
        self._since[hook] = since

    def _last_recorded(self, hook: str) -> float:
        """Returns the Unix time from which events are reported to a hook.

        For a new hook this is now, which is stored: earlier events are not reported.
        """
        with self._sessions.begin() as session:
            latest = session.scalar(select(func.max(Delivery.ended)).where(Delivery.hook == hook))
            if latest is None:
                latest = time.time()
                session.add(Delivery(id=uuid.uuid4().hex, hook=hook, job="", ended=latest, message={}, done=latest))
            session.execute(
                delete(Delivery).where(
                    Delivery.job != "", Delivery.due.is_(None), Delivery.ended < time.time() - KEEP_DELIVERED_S
                )
            )
        return latest

    def _row(self, hook: str, job: Job) -> Delivery:
        message = job_message(job, self._settings.public_url)
        return Delivery(
            id=f"msg_{uuid.uuid4().hex}", hook=hook, job=job.id, ended=_event_time(job), message=message, due=time.time()
        )

    def _send_due(self, hook: str) -> None:
        """Sends a hook's due messages until one fails; then pauses that hook for a while."""
        if time.monotonic() < self._rests.get(hook, 0.0):
            return
        now = time.time()
        with self._sessions() as session:
            is_due = or_(Delivery.due <= now, Delivery.due > now + 2 * RETRIES_S[-1])  # or scheduled by a clock that was ahead
            due = select(Delivery).where(is_due, Delivery.hook == hook)
            rows = list(session.scalars(due.order_by(Delivery.due).limit(AT_A_TIME)))
        for row in rows:
            if self._stop.is_set():
                return
            row.attempts += 1
            try:
                self.send_now(row.hook, row.id, row.message)
                row.due, row.done, row.error = None, time.time(), None
                self._rests.pop(hook, None)
            except Exception as error:  # a fault in one message must not block other hooks, and is not retried forever
                if not isinstance(error, UndeliveredError):
                    log.exception("unexpected error while notifying %s of job %s", redacted_hook(row.hook), row.job)
                # One failure delays all waiting messages, so that not each of them waits for the timeout.
                self._rests[hook] = time.monotonic() + min(RETRIES_S[min(row.attempts, len(RETRIES_S)) - 1], MAX_HOOK_PAUSE_S)
                is_given_up = isinstance(error, RefusedError) or row.attempts > len(RETRIES_S)
                row.due = None if is_given_up else time.time() + RETRIES_S[row.attempts - 1]
                row.error = str(error)
                log.warning("Notifying %s of job %s failed: %s", redacted_hook(row.hook), row.job, error)
            with self._sessions.begin() as session:
                session.merge(row)
            if row.done is None:
                return


def _event_time(job: Job) -> float:
    """Returns the Unix time of the reported event: when the job ended, or when it became late."""
    return (job.finished if job.state in FINAL_STATES else job.late) or 0.0
