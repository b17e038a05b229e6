"""Tests of which token a command uses on the service's own machine: the owner's token as configured, or the stored one."""

from __future__ import annotations

from pathlib import Path

import pytest

from rayfarm.login import owner_token


def test_configured_owner_token_precedes_stored_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert owner_token(tmp_path) == ""
    (tmp_path / "owner-token").write_text("kept\n")
    assert owner_token(tmp_path) == "kept"
    monkeypatch.setenv("RAYFARM_OWNER_TOKEN", "told")
    assert owner_token(tmp_path) == "told"
