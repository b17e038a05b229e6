"""Fixture: a service for tests of the client's commands."""

from __future__ import annotations

from tests.service.conftest import database, databases, redis_server, service, worker

__all__ = ["database", "databases", "redis_server", "service", "worker"]
