"""A worker's heartbeat: writes its report to Redis under a key that expires.

The event loop that fetches the worker's tasks also writes its report, so a worker whose loop hangs stops reporting, and the
service notices. Each beat also resets a watchdog timer, and detects that no task arrives although the queue has some (Celery
issues 8030, 9054, 10205). If the timer expires or no task arrives, the process ends, and its supervisor restarts it.
"""

from __future__ import annotations

import contextlib
import json
import logging
import math
import os
import signal
import time
from dataclasses import replace
from typing import Any

import redis
from celery import bootsteps
from celery.worker.state import reserved_requests

from protocol import vitals
from protocol.card import RENDER_ON_CARD, card_queue
from protocol.contract import (
    HEARTBEAT_EVERY_S,
    HEARTBEAT_TTL_S,
    RENDER_BATCH,
    RENDER_BATCHES,
    RESULTS,
    WorkerReport,
    worker_key,
)
from protocol.joint import RENDER_JOINTLY, help_queue
from protocol.lifeline import lifeline
from protocol.vitals import LOG_TTL_S, VITALS_TTL_S, log_key, vitals_key
from worker.exchange.heartbeat_message import HeartbeatConnection, HeartbeatReply
from worker.machine import health_file
from worker.machine.health_file import WorkerState
from worker.process import context
from worker.work.joint_render import ask_for_help

__all__ = ["Heartbeat", "Reporter"]

WATCHDOG_S = 60
IDLE_LIMIT_S = 20.0
VITALS_EVERY_S = 5.0
BATCH_TASKS = (RENDER_BATCH, RENDER_BATCHES, RENDER_JOINTLY, RENDER_ON_CARD)
REPLY_WAIT_S = 0.05  # seconds to wait for Redis's reply; a later one is read at the next beat

log = logging.getLogger(__name__)


class Reporter:
    """Writes a worker's report over a Redis connection of its own.

    Does not raise if Redis is unreachable, so the worker continues.
    """

    def __init__(self, redis_url: str) -> None:
        self.redis = redis.Redis.from_url(redis_url, socket_timeout=2, socket_connect_timeout=2)

    def write_report(self, report: WorkerReport) -> bool:
        """Writes a report. Returns False if Redis does not store it."""
        try:
            with self.redis.pipeline(transaction=False) as both:
                both.client_setname(lifeline(report.name))  # repeated, since the connection may be new
                both.set(worker_key(report.name), report.to_bytes(), ex=HEARTBEAT_TTL_S)
                return both.execute(raise_on_error=False)[1] is True
        except redis.RedisError:
            return False

    def delete_report(self, name: str) -> None:
        """Deletes the report, so that the service need not wait for it to expire."""
        with contextlib.suppress(redis.RedisError):
            self.redis.delete(worker_key(name), help_queue(name))


class Heartbeat(bootsteps.StartStopStep):
    """A Celery bootstep of the consumer: sends heartbeats from the consumer's event loop. Restarted after a reconnection."""

    requires = ("celery.worker.consumer.tasks:Tasks",)

    def __init__(self, consumer: Any, **kwargs: Any) -> None:
        super().__init__(consumer, **kwargs)
        self.worker = context.current()
        self.connection = HeartbeatConnection(self.worker.redis_url)
        self.latest = HeartbeatReply(is_stored=False)  # the latest reply
        self.consumer = consumer
        self.has_come = False
        self.is_paused = False
        self.served: tuple[str, ...] = ()  # requirement queues being consumed
        self.logged_error = ""  # the latest
        self.timer: Any = None
        self.idle_since = time.monotonic()
        self.vitals_sent = -math.inf  # time when vitals were last sent

    def start(self, consumer: Any) -> None:
        """Starts the heartbeat."""
        health_file.write_state(WorkerState.WORKING)
        self.idle_since = time.monotonic()
        self.beat()
        self.timer = consumer.timer.call_repeatedly(HEARTBEAT_EVERY_S, self.beat)

    def stop(self, consumer: Any) -> None:
        """Stops the heartbeat before a shutdown or a reconnection."""
        health_file.write_state(WorkerState.AWAY)
        if self.timer is not None:
            self.timer.cancel()
            self.timer = None

    def beat(self) -> None:
        """Sends the report, resets the watchdog, applies required run-time settings, and checks that queued tasks arrive."""
        health_file.write_state(WorkerState.WORKING)
        if self.worker.cards_worker is not None:
            self.worker.cards_worker.check()
        latest = self.connection.receive()  # on a slow line, the reply to an earlier beat
        self._send_report()
        if (latest := self.connection.receive(REPLY_WAIT_S) or latest) is not None:
            self.latest = latest
        before = self.is_paused, self.served
        self._apply_terms()
        self._apply_pause()
        if before != (self.is_paused, self.served):
            self._send_report()  # at once instead of with the next beat
        if latest is not None and latest.is_stored:
            self._handle_reply(latest)

    def _send_report(self) -> None:
        worker, now = self.worker, time.monotonic()
        report = worker.report(self.is_paused)
        report = replace(report, in_hand=[*dict.fromkeys([*report.in_hand, *_unfinished_messages()])])
        more: list[tuple[Any, ...]] = []
        if not self.has_come:  # wakes the service, which then sees the new worker at once
            self.has_come = True
            more.append(("XADD", RESULTS, "*", "event", json.dumps({"type": "wake"})))
        if now - self.vitals_sent > VITALS_EVERY_S and (found := vitals.read_vitals()) is not None:
            self.vitals_sent = now
            more.append(("SET", vitals_key(worker.name), found.to_bytes(), "EX", VITALS_TTL_S))
        if worker.tail is not None:
            worker.tail.trim()
            if self.latest.is_log_wanted:
                more.append(("SET", log_key(worker.name), json.dumps(worker.tail.lines()), "EX", LOG_TTL_S))
        self.connection.send(report, worker.keeping.offer() if worker.keeping is not None else None, more)

    def _handle_reply(self, reply: HeartbeatReply) -> None:
        signal.alarm(WATCHDOG_S)  # unless reset, SIGALRM ends this process and with it its children
        report, now = self.worker.report(self.is_paused), time.monotonic()
        self._request_help(report, reply)
        if self.is_paused or any(report.current) or not reply.waiting:
            self.idle_since = now
        elif now - self.idle_since > IDLE_LIMIT_S:
            log.error("no queued task has arrived for %.0f s; restarting", IDLE_LIMIT_S)
            self.idle_since = now
            os.kill(os.getpid(), signal.SIGTERM)

    def _request_help(self, report: WorkerReport, reply: HeartbeatReply) -> None:
        """Asks free slots to render the waiting pieces of joint batches, if no such request is queued (protocol/joint.py).

        A slot that received an earlier request may have died.
        """
        free = sum(not doing for doing in report.current)
        if self.worker.pieces is not None and report.in_hand and free and not reply.is_help_queued:
            with contextlib.suppress(OSError):
                ask_for_help(self.consumer.app, self.worker, min(free, max(self.worker.pieces.free_count(), 1)))

    def _apply_pause(self) -> None:
        """Pauses or resumes the fetching of tasks as the service requires. Running tasks are always finished."""
        keeping = self.worker.keeping
        wanted = (keeping is not None and keeping.why is not None) or self.latest.is_paused
        if wanted == self.is_paused:
            self._serve_requirement_queues(() if wanted or keeping is None else keeping.terms.queues)
            return
        try:
            for queue in self.worker.queues:
                if queue == help_queue(self.worker.name):
                    continue  # started pieces are finished even while paused
                if wanted:
                    self.consumer.cancel_task_queue(queue)
                else:
                    self.consumer.add_task_queue(queue)
        except redis.RedisError as error:
            if str(error) != self.logged_error:
                self.logged_error = str(error)
                log.warning("tasks cannot be %s now: %s", "left" if wanted else "taken", error)
            return  # retried at the next beat
        self.is_paused = wanted
        self.logged_error = ""
        why = keeping.why if keeping is not None else None
        log.warning("%s", (why or "paused by the service") if wanted else "taking tasks again")
        self._serve_requirement_queues(() if wanted or keeping is None else keeping.terms.queues)

    def _serve_requirement_queues(self, queues: tuple[str, ...]) -> None:
        """Makes this worker serve exactly these requirement queues, in addition to its own queues.

        A requirement queue has the batches that need certain tags or memory. A worker with graphics cards serves none: the
        service sends all its batches to its own queue.
        """
        if card_queue(self.worker.name) in self.worker.queues:
            self.served = queues
            return
        try:
            for queue in self.served:
                if queue not in queues:
                    self.consumer.cancel_task_queue(queue)
            for queue in queues:
                if queue not in self.served:
                    self.consumer.add_task_queue(queue)
        except redis.RedisError as error:
            log.warning("queues cannot be changed now: %s", error)
            return  # retried at the next beat; repeated calls are harmless
        self.served = queues

    def _apply_terms(self) -> None:
        """Applies the run-time settings (protocol/terms.py) that the service requires, including the number of slots.

        Running tasks are always finished.
        """
        if (keeping := self.worker.keeping) is None:
            return
        keeping.request(self.latest.terms)
        keeping.refresh()
        # Tasks are acknowledged when they finish, so the prefetch count limits the number of running tasks.
        if missing := keeping.slots_now - self.consumer.qos.value:
            change = self.consumer.qos.increment_eventually if missing > 0 else self.consumer.qos.decrement_eventually
            change(abs(missing))


def _unfinished_messages() -> list[str]:
    """Returns the ids of batch messages that were fetched from the queue and are not finished.

    Needed in addition to the slots' reports, since a slot of a busy machine may take seconds to report its batch.
    """
    return [request.id for request in list(reserved_requests) if request.name in BATCH_TASKS]
