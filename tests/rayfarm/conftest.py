"""A service to look at."""

from __future__ import annotations

from tests.service.conftest import redis_server, service, worker

__all__ = ["redis_server", "service", "worker"]
