"""Celery settings, used by both the service and the workers."""

from __future__ import annotations

from typing import Any

__all__ = ["celery_config"]


def celery_config(redis_url: str) -> dict[str, Any]:
    """Returns the Celery settings.

    If a child process is killed, its batch returns to the queue (acks_late, reject_on_worker_lost). There is no result backend,
    since results are sent on a Redis stream. The visibility timeout exceeds the hard time limit, so the broker never delivers a
    running task twice. The service's own leases are shorter, and duplicates have no effect.
    """
    return {
        "broker_url": redis_url,
        "result_backend": None,
        "task_ignore_result": True,
        "task_serializer": "json",
        "accept_content": ["json"],
        "task_acks_late": True,
        "task_reject_on_worker_lost": True,
        "worker_prefetch_multiplier": 1,
        "task_time_limit": 900,
        "broker_transport_options": {"visibility_timeout": 1200},
        "broker_connection_retry_on_startup": True,
        "worker_send_task_events": False,
        "worker_enable_remote_control": False,
        "task_create_missing_queues": True,
    }
