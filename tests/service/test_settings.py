"""The service's settings, out of an environment that somebody wrote."""

from __future__ import annotations

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
