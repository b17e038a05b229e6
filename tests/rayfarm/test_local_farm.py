"""What `rayfarm up` starts, without starting it."""

from __future__ import annotations

from pathlib import Path

import pytest

from rayfarm.local.farm import LocalFarm
from rayfarm.local.supervisor import Part


@pytest.mark.parametrize(("host", "listens"), [("::", ""), ("127.0.0.1", "127.0.0.1"), ("0.0.0.0", "0.0.0.0")])
def test_any_address_of_ipv6_is_any_of_ipv4_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, host: str, listens: str) -> None:
    started: list[Part] = []
    farm = LocalFarm(tmp_path, host, 0, 0, lambda sentence: None)
    monkeypatch.setattr(farm, "_start", started.append)
    monkeypatch.setattr(farm, "wait", lambda *arguments: True)
    farm.start(lambda: False)
    service = next(part for part in started if part.name == "service")
    assert service.command[service.command.index("--host") + 1] == listens
    assert service.env["RAYFARM_HOST"] == listens
