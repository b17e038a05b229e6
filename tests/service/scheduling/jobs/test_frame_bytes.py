"""Tests of the storage used by a shot's compiled frames, and of which frames are deleted if space is short."""

from __future__ import annotations

import hashlib
import time
from pathlib import Path

import pytest

from protocol.contract import RenderBatch
from tests.helpers import running_redis
from tests.service.conftest import Service, until
from tests.service.scheduling.test_shots import blobs, digest, expected, submit_shot


@pytest.mark.long
def test_last_needed_frame_is_deleted_if_space_is_short(tmp_path: Path, redis_server: running_redis) -> None:
    service = Service(tmp_path / "data", redis_server, frame_scenes_bytes=4000)
    try:
        with service.worker() as worker:
            most = 0

            def look(batch: RenderBatch) -> None:
                nonlocal most
                compiled = [name for name, content in blobs(tmp_path / "data").items() if len(content) == 1006]
                most = max(most, len(compiled))
                assert batch.compiled in compiled, "what is rendered is there"

            def make(frame: float) -> bytes:
                time.sleep(0.05)
                return b"%06d" % frame + b"x" * 1000

            worker.on_frame = make
            worker.on_batch = look
            job = submit_shot(service, service.ready_scene(), "0-19", order="breadth-first", spp=4)
            service.wait_for(job, "finished", 60)
            assert [digest(service, job, n) for n in range(20)] == [expected(n) for n in range(20)]
            assert most < 12, "never all twenty"
            assert len(worker.frames) > 20
    finally:
        service.stop()


@pytest.mark.long
def test_shared_part_is_counted_once_and_kept(tmp_path: Path, redis_server: running_redis) -> None:
    service = Service(tmp_path / "data", redis_server, frame_scenes_bytes=6000)
    shared = b"what stands still" * 200
    part = tmp_path / "data" / "blobs" / hashlib.sha256(shared).hexdigest()[:2] / hashlib.sha256(shared).hexdigest()

    def left() -> int:
        return sum(len(content) in (106, len(shared)) for content in blobs(tmp_path / "data").values())

    def look(batch: RenderBatch) -> None:
        assert part.is_file()

    try:
        with service.worker() as worker:
            worker.shared, worker.on_batch = shared, look
            worker.on_frame = lambda frame: b"%06d" % frame + b"x" * 100
            job = submit_shot(service, service.ready_scene(), "0-9", order="breadth-first", spp=4)
            service.wait_for(job, "finished", 60)
            assert [digest(service, job, n) for n in range(10)] == [expected(n) for n in range(10)]
            assert sorted(worker.frames) == list(range(10)), "there is room for all of them, as each has but a little of its own"
            until(lambda: left() == 0, "what was compiled for frames is gone", say=left)
    finally:
        service.stop()
