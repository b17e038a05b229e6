"""Celery application of a worker process, and the functions that run before and after it forks."""

from __future__ import annotations

import logging
import signal
import sys
import warnings
from typing import Any

from billiard.util import get_logger
from celery import Celery, signals
from celery.exceptions import SecurityWarning

from protocol.broker import celery_config
from renderer import __version__
from renderer.child_processes import die_with_parent
from telemetry import tracing
from telemetry.log_lines import uses_json
from worker import tasks
from worker.heartbeat import Heartbeat
from worker.process import context
from worker.process.queue_order import STRATEGY
from worker.process.queue_reading import skip_malformed_messages
from worker.process.slot_number import slot
from worker.shutdown_reporter import ShutdownReporter
from worker.work.frames import forget_frames
from worker.work.joint_render import send_all_sums

__all__ = ["make_app", "run"]

SHUTDOWN_S = 600  # a warm shutdown waits for running tasks; after this the watchdog ends it


def make_app(worker: context.WorkerContext) -> Celery:
    """Creates the Celery application with the tasks and queues of this worker."""
    skip_malformed_messages(worker.queue_of_returned(""))
    app = Celery("rayfarm", set_as_current=False)
    app.conf.update(celery_config(worker.redis_url))
    app.conf.broker_transport_options = {
        **app.conf.broker_transport_options,
        "queue_order_strategy": STRATEGY,
        "ack_emulation": not worker.is_over_https,
    }
    app.conf.update(
        # A task survives a lost connection: its result goes to the stream, and a redelivery is harmless.
        worker_cancel_long_running_tasks_on_connection_loss=False,
        # Celery lowers the prefetch count after a reconnect and may not raise it again, which leaves the worker idle.
        worker_enable_prefetch_count_reduction=False,
        worker_hijack_root_logger=False,
        worker_redirect_stdouts=False,
        broker_connection_max_retries=None,
        # A busy machine may take longer than Celery's 4 s to start a slot; killing it then only adds load.
        worker_proc_alive_timeout=60.0,
    )
    tasks.register(app)
    app.steps["consumer"].add(Heartbeat)
    return app


def run(worker: context.WorkerContext) -> int:
    """Processes tasks until a signal stops the worker; returns the exit code. On SIGTERM, finishes the running tasks first."""
    # Celery warns root users because of pickle; only JSON is accepted here.
    warnings.filterwarnings("ignore", category=SecurityWarning)
    context.set_current(worker)
    if uses_json():
        signals.setup_logging.connect(_configure_log)
    signals.worker_process_init.connect(_on_slot_start)
    signals.worker_process_shutdown.connect(_on_slot_end)
    signals.worker_shutting_down.connect(_on_shutdown)
    leaving = ShutdownReporter(worker)
    signals.worker_shutting_down.connect(leaving.begin)
    celery = make_app(worker).Worker(
        hostname=f"{worker.name}@{worker.host}",
        pool="prefork",
        concurrency=worker.slots,
        queues=worker.queues,
        optimization="fair",
        without_gossip=True,
        without_mingle=True,
        without_heartbeat=True,
        quiet=True,
        loglevel="WARNING",
    )
    tracing.start_tracing("rayfarm-worker", worker.name, __version__)
    celery.start()
    send_all_sums(celery.app, worker)
    leaving.stop()
    if worker.pieces is not None:
        worker.pieces.close()
    tracing.stop_tracing()
    return int(celery.exitcode or 0)


def _configure_log(**_: Any) -> None:
    """Replaces Celery's logging set-up: its loggers propagate to the worker's, from level WARNING."""
    for name in ("celery", "kombu", "amqp", "multiprocessing"):
        logging.getLogger(name).setLevel(logging.WARNING)
    get_logger().propagate = True  # billiard's logger does not propagate by default
    setattr(sys, "__stdout__", None)  # noqa: B010 - where Celery writes that it shuts down, past all loggers


def _on_slot_start(**_: Any) -> None:
    """Initializes a new slot process: ends it together with its parent, opens its connections, and reports the slot as free."""
    worker = context.current()
    die_with_parent(worker.pid)
    worker.after_fork()
    worker.board.write(slot(), {})


def _on_slot_end(**_: Any) -> None:
    forget_frames()


def _on_shutdown(how: str = "", **_: Any) -> None:
    """Receives Celery's signal. how: its name of the kind of shutdown, Warm or Cold."""
    signal.alarm(SHUTDOWN_S)
    if (cards_worker := context.current().cards_worker) is not None:
        cards_worker.stop()
    if uses_json():
        logging.getLogger("worker").info("%s shutdown", how)
