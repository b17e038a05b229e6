"""Tests of stored snapshots of films in progress: complete, within the limits, and deleted with their job."""

from __future__ import annotations

import os
from pathlib import Path

from service.store.film_snapshots import FilmSnapshot, FilmSnapshots


def metadata(spp: int) -> FilmSnapshot:
    return FilmSnapshot(spp, spp, 2 * spp, 100 * spp, 1.5, None, 12.0)


def test_snapshot_round_trip(tmp_path: Path) -> None:
    kept = FilmSnapshots(tmp_path / "snapshots", 1 << 20, 0)
    assert kept.accept("job") == [] == kept.all_metadata("job")
    for spp in (8, 1, 128):
        assert kept.write("job", metadata(spp), [b"some", b"\nlight"])
    (tmp_path / "snapshots" / "job" / "4.film").write_bytes(b"not to be understood\n")
    again = FilmSnapshots(tmp_path / "snapshots", 1 << 20, 0)
    assert again.accept("job") == [1, 4, 8, 128] and again.all_metadata("job") == [metadata(1), metadata(8), metadata(128)]
    size, pieces = again.packed("job", 8)
    assert size == 10 and b"".join(pieces) == b"some\nlight"
    assert again.find("job", 2) is None and again.find("other", 1) is None


def test_oldest_snapshots_of_other_jobs_are_deleted_first(tmp_path: Path) -> None:
    room = 2500
    kept = FilmSnapshots(tmp_path / "snapshots", room, 0)
    for at, job in enumerate(("first", "second", "third")):
        kept.accept(job)
        assert kept.write(job, metadata(1), [bytes(1000)])
        os.utime(tmp_path / "snapshots" / job, (at, at))
    assert [kept.stored_spp(job) for job in ("first", "second", "third")] == [[], [1], [1]]
    assert not kept.write("third", metadata(2), [bytes(room)]), "a file larger than the cache evicts no other"
    assert kept.stored_spp("second") == [1]
    assert not FilmSnapshots(tmp_path / "snapshots", room, 1 << 60).write("third", metadata(4), [b""]), "on a full disk"


def test_snapshots_are_deleted_with_job(tmp_path: Path) -> None:
    kept = FilmSnapshots(tmp_path / "snapshots", 1 << 20, 0)
    for job in ("kept", "gone"):
        kept.accept(job)
        kept.write(job, metadata(1), [b""])
    kept.drop("gone")
    assert not kept.write("gone", metadata(2), [b""]), "which was on its way while the job was deleted"
    kept.accept("lost")
    kept.write("lost", metadata(1), [b""])
    (tmp_path / "snapshots" / ".half").write_bytes(b"begun")
    kept.sweep({"kept", "gone"})
    assert [path.name for path in (tmp_path / "snapshots").iterdir()] == ["kept"]
