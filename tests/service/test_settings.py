"""The service's settings, out of an environment that somebody wrote."""

from __future__ import annotations

import errno
import os
import re
from pathlib import Path

import pytest

from service.errors import CannotStart
from service.main import create_app
from service.settings import Settings


@pytest.mark.parametrize(
    ("name", "value", "why"),
    [
        ("RAYFARM_PORT", "x", "RAYFARM_PORT makes no sense: input should be a valid integer"),
        ("RAYFARM_BLOBS", "x", "RAYFARM_BLOBS makes no sense: 'x' is no address of blobs"),
        ("RAYFARM_WEBHOOKS", "x", "RAYFARM_WEBHOOKS makes no sense: it is no JSON"),
    ],
)
def test_what_makes_no_sense_is_named(
    name: str, value: str, why: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(name, value)
    with pytest.raises(CannotStart, match=why):
        Settings.read()
    with pytest.raises(SystemExit) as ended:
        create_app()
    assert (ended.value.code, why in capsys.readouterr().err) == (3, True)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS])
def test_a_data_folder_that_cannot_be_written_is_a_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    def refused(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("service.settings.write_once", refused)
    with pytest.raises(CannotStart, match=f"{re.escape(str(tmp_path))}.*{os.strerror(number)}.*RAYFARM_DATA"):
        Settings(data=tmp_path / "data").make_folders()
