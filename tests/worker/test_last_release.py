"""Tests of a worker of this release with a service of the previous one: responses and messages recorded from release 0.1.0."""

from __future__ import annotations

import base64
import json
from typing import Any

import pytest

from protocol.contract import DenoiseFrame, Manifest, RenderBatch, Result, SceneInfo, WorkerReport
from protocol.sums import pack_sums, unpack_sums
from renderer.film import digest
from renderer.settings import RenderSettings, Tile
from tests.foreign_server import foreign_server, json_answer
from tests.helpers import ROOT
from worker.exchange.link import Link

OLD = json.loads((ROOT / "tests" / "data" / "release-0.1.0.json").read_text())
READERS: dict[str, tuple[Any, Any]] = {
    "manifest": (Manifest.from_json, OLD["manifest"]),
    "batch": (RenderBatch.from_json, OLD["batch"]),
    "denoise": (DenoiseFrame.from_json, OLD["denoise"]),
    "info": (SceneInfo.from_json, OLD["events"]["prepared"]["info"]),
    "report": (lambda data: WorkerReport.from_bytes(json.dumps(data).encode()), OLD["report"]),
}


def test_worker_joins_service_of_previous_release() -> None:
    def answer(request: bytes) -> bytes:
        return json_answer(OLD["join"] if b"/join" in request else OLD["manifest"])

    with foreign_server(answer) as port:
        link = Link(f"http://127.0.0.1:{port}", "token")
        joined = link.join()
        assert (joined.redis_url, joined.instance) == (OLD["join"]["redis_url"], OLD["join"]["instance"])
        assert link.manifest("s").files[0].sha256 == OLD["manifest"]["files"][0]["sha256"]
        link.client.close()


def test_settings_and_sums_of_previous_release_are_read() -> None:
    settings = RenderSettings.from_json(OLD["job"]["settings"])
    assert (settings.seed, settings.light_samples, settings.environment) == (7, 2, (0.5, 0.6, 0.7))
    assert settings == RenderBatch.from_json(OLD["batch"]).settings
    sums = unpack_sums(base64.b64decode(OLD["sums"]), Tile(0, 0, 16, 8))
    assert pack_sums(sums, packing=1) == base64.b64decode(OLD["sums"])
    assert len(digest(sums)) == 64


@pytest.mark.parametrize("name", READERS)
def test_messages_of_previous_and_newer_release_are_read(name: str) -> None:
    read, data = READERS[name]
    assert read(data) == read(data | {"of a newer release": [1, 2]})


@pytest.mark.parametrize("name", READERS)
def test_invalid_message_raises_one_error_type(name: str) -> None:
    read, data = READERS[name]
    for key in data:
        cut = {other: value for other, value in data.items() if other != key}
        try:
            read(cut)
        except ValueError as error:
            assert key in str(error)
    for nonsense in (None, [], "text", 7):
        with pytest.raises(ValueError, match="object"):
            read(nonsense)


def test_result_fields_suit_previous_release() -> None:
    event = OLD["events"]["batch"]
    assert Result.from_fields(Result(event, b"sums").to_fields()) == Result(event, b"sums")
