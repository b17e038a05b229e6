"""Redis as `rayfarm up` starts it."""

from __future__ import annotations

from pathlib import Path

import redis

from tests.helpers import running_redis


def test_the_data_may_lie_in_a_folder_of_any_name(tmp_path: Path) -> None:
    """As in a clone at ~/My Projects, or where macOS keeps programs' data: ~/Library/Application Support."""
    folder = tmp_path / 'Application Support "ü" \\n'
    folder.mkdir()
    server = running_redis(folder)
    server.start()
    try:
        with redis.Redis.from_url(server.url) as store:
            assert store.config_get("dir") == {"dir": str(folder)}
    finally:
        server.stop()
