"""Tests of starting and stopping the service's process, with a fake ownership of the farm."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import pytest

from service import process_lifecycle as lives
from service.errors import Unavailable
from service.ownership.candidate import Candidate
from service.process_lifecycle import ServiceLifecycle
from service.settings import Settings


def test_service_start_waits_for_database(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A service that starts while the database is unreachable waits for it instead of ending.

    The database may be locked because the owner is suspended during a write; if the standby ended, none could take over.
    """
    answers: list[Any] = [Unavailable("The database does not answer.")] * 2
    owned: list[object] = []
    was_owned = asyncio.Event()

    def attempt(self: Candidate) -> object:
        if answers:
            raise answers.pop()
        return "owning"

    def own(self: ServiceLifecycle, owning: object) -> None:
        owned.append(owning)
        was_owned.set()

    async def begun() -> None:
        life = ServiceLifecycle(Settings(data=tmp_path), lambda farm: None)
        await life.begin()
        assert life.is_standby
        assert life.is_alive
        assert life.standby_reason == "This service has not started: The database does not answer."
        await asyncio.wait_for(was_owned.wait(), 20)
        await life.stop()

    monkeypatch.setattr(Candidate, "attempt", attempt)
    monkeypatch.setattr(ServiceLifecycle, "_start_farm", own)
    monkeypatch.setattr(lives, "TAKEOVER_ATTEMPT_EVERY_S", 0.01)
    asyncio.run(begun())
    assert owned == ["owning"]
