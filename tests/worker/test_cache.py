"""Blobs by hash: fetched once, checked, evicted, or mapped from the service's own folder."""

from __future__ import annotations

import hashlib
import os
import threading
from pathlib import Path
from typing import BinaryIO

import pytest

from worker.cache import BlobCache
from worker.errors import LinkError
from worker.link import FarmAnswer, Link

ELSEWHERE = FarmAnswer("redis://", "instance-1", "")


class CountingLink(Link):
    """A link whose service is a dict."""

    def __init__(self, blobs: dict[str, bytes]) -> None:
        super().__init__("http://service.invalid", "token")
        self.blobs = blobs
        self.fetched: list[str] = []

    def fetch(self, sha256: str, out: BinaryIO) -> None:
        self.fetched.append(sha256)
        out.write(self.blobs[sha256][:3])
        if self.blobs[sha256].startswith(b"broken"):
            raise LinkError("the connection broke")
        out.write(self.blobs[sha256][3:])


def sha(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def test_a_blob_is_fetched_once(tmp_path: Path) -> None:
    data = b"compiled scene"
    link = CountingLink({sha(data): data})
    cache = BlobCache(link, ELSEWHERE, tmp_path)
    found: list[Path] = []
    threads = [threading.Thread(target=lambda: found.append(cache.path(sha(data)))) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert {path.read_bytes() for path in found} == {data}
    assert link.fetched == [sha(data)]


def test_a_broken_fetch_leaves_nothing(tmp_path: Path) -> None:
    data = b"broken on the way"
    cache = BlobCache(CountingLink({sha(data): data}), ELSEWHERE, tmp_path)
    with pytest.raises(LinkError):
        cache.path(sha(data))
    assert [path for path in tmp_path.rglob("*") if path.is_file() and path.parent.name != "locks"] == []


def test_what_was_used_longest_ago_goes_first(tmp_path: Path) -> None:
    blobs = {sha(data): data for data in (b"a" * 400, b"b" * 400, b"c" * 400)}
    first, second, third = blobs
    cache = BlobCache(CountingLink(blobs), ELSEWHERE, tmp_path, max_bytes=1000)
    os.utime(cache.path(first), (1, 1))
    os.utime(cache.path(second), (2, 2))
    mapped = cache.path(first)  # used again: now the youngest
    with mapped.open("rb") as still_open:
        cache.path(third)
        assert (tmp_path / first[:2] / first).exists()
        assert not (tmp_path / second[:2] / second).exists()
        assert still_open.read() == blobs[first]


def test_a_blob_larger_than_the_cache_is_kept_while_it_is_the_one_in_hand(tmp_path: Path) -> None:
    data = b"x" * 5000
    cache = BlobCache(CountingLink({sha(data): data}), ELSEWHERE, tmp_path, max_bytes=1000)
    assert cache.path(sha(data)).read_bytes() == data


def test_on_the_services_machine_its_files_are_used(tmp_path: Path) -> None:
    data = b"on the same disk"
    home = tmp_path / "data"
    blob = home / "blobs" / sha(data)[:2] / sha(data)
    blob.parent.mkdir(parents=True)
    blob.write_bytes(data)
    (home / "instance").write_text("instance-1\n")
    link = CountingLink({sha(data): data})
    assert BlobCache(link, FarmAnswer("", "instance-1", str(home)), tmp_path / "cache").path(sha(data)) == blob
    # Another service's folder at the same path is not this service's.
    other = BlobCache(link, FarmAnswer("", "instance-2", str(home)), tmp_path / "cache")
    assert other.path(sha(data)) != blob
    assert link.fetched == [sha(data)]


def test_what_was_made_here_is_not_fetched_back(tmp_path: Path) -> None:
    made = tmp_path / "made"
    made.write_bytes(b"made here")
    link = CountingLink({})
    cache = BlobCache(link, ELSEWHERE, tmp_path / "cache")
    cache.adopt(made, sha(b"made here"))
    assert cache.path(sha(b"made here")).read_bytes() == b"made here"
    assert link.fetched == []


def test_a_name_that_is_no_hash_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no SHA-256"):
        BlobCache(CountingLink({}), ELSEWHERE, tmp_path).path("../../etc/passwd")
