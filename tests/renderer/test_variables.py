"""Tests of settings from environment variables: X takes precedence over the file named by X_FILE."""

from __future__ import annotations

from pathlib import Path

import pytest

from renderer.variables import MOST_BYTES, VariableError, value_of


def test_variable_precedes_file_and_default(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert value_of("RAYFARM_TOKEN_OF_A_TEST", "default") == "default"
    file = tmp_path / "token"
    file.write_text("from the file\n")
    monkeypatch.setenv("RAYFARM_TOKEN_OF_A_TEST_FILE", str(file))
    assert value_of("RAYFARM_TOKEN_OF_A_TEST", "default") == "from the file"
    monkeypatch.setenv("RAYFARM_TOKEN_OF_A_TEST", "")
    assert value_of("RAYFARM_TOKEN_OF_A_TEST") == "from the file", "compose sets what is not given to nothing"
    monkeypatch.setenv("RAYFARM_TOKEN_OF_A_TEST", "set")
    assert value_of("RAYFARM_TOKEN_OF_A_TEST") == "set"


@pytest.mark.parametrize(
    ("content", "why"),
    [(None, "cannot be read"), (b"\n", "is empty"), (b"\xff\xfe", "is not text"), (b"x" * (MOST_BYTES + 1), "more than")],
)
def test_empty_variable_file_is_an_error(
    content: bytes | None, why: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    file = tmp_path / "token"
    if content is not None:
        file.write_bytes(content)
    monkeypatch.setenv("RAYFARM_TOKEN_OF_A_TEST_FILE", str(file))
    with pytest.raises(VariableError, match=f"RAYFARM_TOKEN_OF_A_TEST_FILE: {file}.*{why}"):
        value_of("RAYFARM_TOKEN_OF_A_TEST")
