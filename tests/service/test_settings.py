"""Tests of the service's settings from environment variables."""

from __future__ import annotations

import errno
import os
import re
import socket
from pathlib import Path
from typing import Any

import pytest

from service.errors import StartupError
from service.main import create_app
from service.settings import Settings
from tests.grids import grid


@pytest.mark.parametrize(
    ("name", "value", "why"),
    [
        ("RAYFARM_PORT", "x", "RAYFARM_PORT is invalid: input should be a valid integer"),
        ("RAYFARM_BLOBS", "x", "RAYFARM_BLOBS is invalid: 'x' is not a blob address"),
        ("RAYFARM_WEBHOOKS", "x", "RAYFARM_WEBHOOKS is invalid: it is not JSON"),
    ],
)
def test_invalid_setting_is_named(
    name: str, value: str, why: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(name, value)
    with pytest.raises(StartupError, match=why):
        Settings.read()
    with pytest.raises(SystemExit) as ended:
        create_app()
    assert (ended.value.code, why in capsys.readouterr().err) == (3, True)


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS])
def test_unwritable_data_folder_gives_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    def refused(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("service.settings.write_if_missing", refused)
    with pytest.raises(StartupError, match=f"{re.escape(str(tmp_path))}.*{os.strerror(number)}.*RAYFARM_DATA"):
        Settings(data=tmp_path / "data").make_folders()


@pytest.mark.parametrize(
    ("given", "url"),
    [
        ({"public_url": "https://farm.example/"}, "https://farm.example"),
        ({"host": "0.0.0.0", "published": "farm.example 0.0.0.0 127.0.0.1"}, "https://farm.example"),
        ({"host": "0.0.0.0", "published": " 0.0.0.0", "published_port": 9000}, "http://localhost:9000"),
        ({"host": "0.0.0.0", "published": "127.0.0.1"}, "http://127.0.0.1:8000"),
        ({"host": "192.0.2.7", "port": 8002}, "http://192.0.2.7:8002"),
        ({"host": "2001:db8::7"}, "http://[2001:db8::7]:8000"),
        ({"host": "0.0.0.0"}, f"http://{socket.gethostname()}:8000"),
    ],
)
def test_page_url_follows_settings(given: dict[str, Any], url: str, tmp_path: Path) -> None:
    assert Settings(data=tmp_path, **given).page_url == url


@grid("name", Settings.model_fields)
def test_every_setting_is_read_from_file(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Every setting may be given in a file; the environment variable takes precedence if both are set."""
    values = {
        "allowed_hosts": '["farm.example"]',
        "blobs": "s3://bucket/prefix",
        "login": "always",
        "oidc_role": "submit",
        "oidc_roles": '{"artists": "submit"}',
        "redis_url": "redis://:x@queue.example:6379/0",
        "trusted_proxies": "127.0.0.1 10.0.0.0/8",
        "verify": "1",
        "webhooks": '["https://studio.example/rayfarm"]',
        "webhook_secret": "whsec_C2FVsBQIhrscChlQIMV+b5sSYspob7oD",
        "data": str(tmp_path / "farm"),
    }
    default = getattr(Settings.read(), name)
    value = values.get(name, str(not default) if isinstance(default, bool) else "8")
    file = tmp_path / "value"
    file.write_text(f"{value}\n")
    monkeypatch.setenv(f"RAYFARM_{name.upper()}", value)
    expected = getattr(Settings.read(), name)
    assert expected != default
    monkeypatch.delenv(f"RAYFARM_{name.upper()}")
    monkeypatch.setenv(f"RAYFARM_{name.upper()}_FILE", str(file))
    assert getattr(Settings.read(), name) == expected
    assert getattr(Settings.read(**{name: expected}), name) == expected


def test_unreadable_secret_file_gives_error(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("RAYFARM_TOKEN_FILE", str(tmp_path / "none"))
    with pytest.raises(StartupError, match=r"RAYFARM_TOKEN_FILE: .*none cannot be read \(No such file or directory\)"):
        Settings.read()


@pytest.mark.parametrize(
    ("url", "with_it"),
    [
        ("redis://redis:6379/0", "redis://:p%2Fw%40@redis:6379/0"),
        ("redis://farm@redis:6379/0", "redis://farm:p%2Fw%40@redis:6379/0"),
        ("redis://:own@redis:6379/0", "redis://:own@redis:6379/0"),
        ("redis://[::1]:6379", "redis://:p%2Fw%40@[::1]:6379"),
    ],
)
def test_redis_password_is_inserted_into_urls(url: str, with_it: str) -> None:
    """The Redis password is inserted into URLs without one, also into the URL for workers."""
    settings = Settings(redis_url=url, redis_password="p/w@", public_redis_url=url)
    assert (settings.redis_url, settings.worker_redis_url) == (with_it, with_it)
