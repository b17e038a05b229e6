"""Tests of the blob cache: each blob is downloaded once, verified and evicted, or mapped from the service's own folder."""

from __future__ import annotations

import errno
import hashlib
import os
import threading
from pathlib import Path
from typing import BinaryIO

import pytest

from worker.exchange.cache import BlobCache
from worker.exchange.errors import LinkError, MachineError
from worker.exchange.link import FarmAnswer, Link

ELSEWHERE = FarmAnswer("redis://", "instance-1", "")


class CountingLink(Link):
    """A substitute for the link to the service. Its blobs come from a dict, and it records the hashes of downloaded blobs.

    Downloading a blob that starts with b"broken" raises LinkError after the first 3 bytes.
    """

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


def test_blob_is_downloaded_once(tmp_path: Path) -> None:
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


def test_failed_download_leaves_no_file(tmp_path: Path) -> None:
    data = b"broken on the way"
    cache = BlobCache(CountingLink({sha(data): data}), ELSEWHERE, tmp_path)
    with pytest.raises(LinkError):
        cache.path(sha(data))
    assert [path for path in tmp_path.rglob("*") if path.is_file() and path.parent.name != "locks"] == []


def test_least_recently_used_blob_is_evicted_first(tmp_path: Path) -> None:
    blobs = {sha(data): data for data in (b"a" * 400, b"b" * 400, b"c" * 400)}
    first, second, third = blobs
    cache = BlobCache(CountingLink(blobs), ELSEWHERE, tmp_path, max_bytes=1000)
    os.utime(cache.path(first), (1, 1))
    os.utime(cache.path(second), (2, 2))
    mapped = cache.path(first)  # used again, so now the most recent
    with mapped.open("rb") as still_open:
        cache.path(third)
        assert (tmp_path / first[:2] / first).exists()
        assert not (tmp_path / second[:2] / second).exists()
        assert still_open.read() == blobs[first]


def test_blob_larger_than_cache_is_stored(tmp_path: Path) -> None:
    data = b"x" * 5000
    cache = BlobCache(CountingLink({sha(data): data}), ELSEWHERE, tmp_path, max_bytes=1000)
    assert cache.path(sha(data)).read_bytes() == data


def test_local_service_files_are_used_directly(tmp_path: Path) -> None:
    data = b"on the same disk"
    home = tmp_path / "data"
    blob = home / "blobs" / sha(data)[:2] / sha(data)
    blob.parent.mkdir(parents=True)
    blob.write_bytes(data)
    (home / "instance").write_text("instance-1\n")
    link = CountingLink({sha(data): data})
    assert BlobCache(link, FarmAnswer("", "instance-1", str(home)), tmp_path / "cache").path(sha(data)) == blob
    # A folder of another service at the same path is not used.
    other = BlobCache(link, FarmAnswer("", "instance-2", str(home)), tmp_path / "cache")
    assert other.path(sha(data)) != blob
    assert link.fetched == [sha(data)]


def test_locally_created_blob_is_not_downloaded(tmp_path: Path) -> None:
    made = tmp_path / "made"
    made.write_bytes(b"made here")
    link = CountingLink({})
    cache = BlobCache(link, ELSEWHERE, tmp_path / "cache")
    cache.add_copy(made, sha(b"made here"))
    assert cache.path(sha(b"made here")).read_bytes() == b"made here"
    assert link.fetched == []


def test_name_that_is_no_hash_is_rejected(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not a SHA-256"):
        BlobCache(CountingLink({}), ELSEWHERE, tmp_path).path("../../etc/passwd")


def test_eviction_keeps_files_that_another_slot_is_writing(tmp_path: Path) -> None:
    """Checks that eviction keeps a file that another slot is writing, however old it is, but removes that of a killed slot."""
    slow, other = b"slow" * 100, b"other" * 100
    half_way, go_on = threading.Event(), threading.Event()

    class Slow(CountingLink):
        def fetch(self, sha256: str, out: BinaryIO) -> None:
            if sha256 == sha(slow):
                half_way.set()
                assert go_on.wait(10)
            super().fetch(sha256, out)

    link = Slow({sha(slow): slow, sha(other): other})
    found: list[Path] = []
    thread = threading.Thread(target=lambda: found.append(BlobCache(link, ELSEWHERE, tmp_path, 1).path(sha(slow))))
    thread.start()
    assert half_way.wait(10)
    [part] = tmp_path.glob("??/.part-*")
    orphan = part.parent / ".part-of-a-killed-slot"
    orphan.write_bytes(b"half")
    for path in (part, orphan):
        os.utime(path, (1, 1))
    BlobCache(link, ELSEWHERE, tmp_path, max_bytes=1).path(sha(other))
    assert part.exists()
    assert not orphan.exists()
    go_on.set()
    thread.join()
    assert found[0].read_bytes() == slow


def test_file_is_synced_before_rename(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[str] = []
    fsync, replace = os.fsync, Path.replace
    monkeypatch.setattr(
        "os.fsync", lambda handle: (done.append(Path(f"/proc/self/fd/{handle}").readlink().name), fsync(handle))[1]
    )
    monkeypatch.setattr(Path, "replace", lambda self, target: (done.append("renamed"), replace(self, target))[1])
    data = b"compiled scene"
    BlobCache(CountingLink({sha(data): data}), ELSEWHERE, tmp_path).path(sha(data))
    assert [name[:6] for name in done] == [".part-", "rename", sha(data)[:2]]


def test_damaged_file_is_downloaded_again(tmp_path: Path) -> None:
    data = b"compiled scene"
    link = CountingLink({sha(data): data})
    cache = BlobCache(link, ELSEWHERE, tmp_path)
    path = cache.path(sha(data))
    assert not cache.discard_damaged(sha(data))
    path.write_bytes(b"compiled scenf")
    assert cache.discard_damaged(sha(data))
    assert cache.path(sha(data)).read_bytes() == data
    path.write_bytes(b"")
    assert cache.path(sha(data), len(data)).read_bytes() == data
    assert len(link.fetched) == 3
    assert not cache.discard_damaged(sha(b"never fetched"))


class FullLink(CountingLink):
    """A link whose downloads fail with the error of a full disk while the cache folder holds more than `room` blobs."""

    def __init__(self, blobs: dict[str, bytes], folder: Path) -> None:
        super().__init__(blobs)
        self.folder = folder

    def fetch(self, sha256: str, out: BinaryIO) -> None:
        if len(list(self.folder.glob("??/*"))) > self.room:
            out.write(self.blobs[sha256][:3])
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        super().fetch(sha256, out)

    room = 1


def test_full_disk_evicts_other_blobs_then_raises_error(tmp_path: Path) -> None:
    old, new = b"old" * 100, b"new" * 100
    link = FullLink({sha(old): old, sha(new): new}, tmp_path)
    cache = BlobCache(link, ELSEWHERE, tmp_path)
    cache.path(sha(old))
    assert cache.path(sha(new)).read_bytes() == new
    assert not (tmp_path / sha(old)[:2] / sha(old)).exists()
    link.room = 0
    with pytest.raises(MachineError, match=r"no room for a scene in .*Free some"):
        cache.path(sha(old))
    assert not list(tmp_path.glob("??/.part-*"))


def test_unwritable_cache_raises_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    cache = BlobCache(CountingLink({}), ELSEWHERE, tmp_path / "file" / "blobs")
    with pytest.raises(MachineError, match="Not a directory"):
        cache.check()
    with pytest.raises(MachineError, match="Not a directory"):
        cache.path(sha(b"x"))
    BlobCache(CountingLink({}), ELSEWHERE, tmp_path / "new").check()
