"""Tests of a worker's report about its machine: memory is as the system states it, and invalid values are refused."""

from __future__ import annotations

import psutil
import pytest

from protocol import vitals
from protocol.vitals import Vitals


def test_memory_equals_system_values() -> None:
    found = vitals.read_vitals()
    assert found is not None
    assert found.memory_total == psutil.virtual_memory().total
    assert 0 < found.memory_used < found.memory_total
    assert Vitals.from_bytes(found.to_bytes()) == found


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"[]",
        b"null",
        b"{}",
        b'{"memory_used": 1}',
        b'{"memory_used": true, "memory_total": 2}',
        b'{"memory_used": -1, "memory_total": 2}',
    ],
)
def test_invalid_vitals_are_rejected(data: bytes) -> None:
    with pytest.raises(ValueError):
        Vitals.from_bytes(data)
