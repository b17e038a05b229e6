"""Tests of when a standby declares the owner dead.

It must have sent a request, checked often enough, and waited long enough without an answer.
"""

from __future__ import annotations

from service.ownership.owner_timeout import MIN_CHECKS, OwnerTimeout
from service.store.models import FarmOwner

LEASE_S = 6.0


def row(epoch: int = 5, answered: int = 0) -> FarmOwner:
    return FarmOwner(what="farm", epoch=epoch, asked=1, answered=answered)


def silent_for(seconds: float, looks: int) -> tuple[OwnerTimeout, list[float]]:
    clock = [100.0]
    silence = OwnerTimeout(LEASE_S, lambda: clock[0])
    assert silence.is_request_due(row()), "it was not asked yet"
    silence.record_request(5, 1)
    for _ in range(looks):
        clock[0] += seconds / looks
        assert not silence.is_request_due(row())
    return silence, clock


def test_timeout_expires_after_lease() -> None:
    assert not silent_for(LEASE_S - 0.01, 12)[0].has_expired
    assert silent_for(LEASE_S + 0.01, 12)[0].has_expired


def test_timeout_needs_minimum_number_of_checks() -> None:
    silence, _ = silent_for(1000.0, MIN_CHECKS - 1)
    assert not silence.has_expired
    silence.is_request_due(row())
    assert silence.has_expired


def test_answer_restarts_timeout() -> None:
    silence, clock = silent_for(LEASE_S - 1.0, 8)
    assert silence.is_request_due(row(answered=1))
    assert silence.has_answered(row(answered=1))
    silence.record_request(5, 2)
    clock[0] += LEASE_S - 1.0
    for _ in range(MIN_CHECKS):
        assert not silence.is_request_due(row(answered=1))
    assert not silence.has_expired


def test_new_owner_needs_new_request() -> None:
    silence, _ = silent_for(LEASE_S + 1.0, 8)
    assert silence.is_request_due(row(epoch=6, answered=1))
    assert not silence.has_answered(row(epoch=6, answered=1)), "that was another's answer"
