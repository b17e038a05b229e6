"""Tests of scenes that require Blender.

Only workers with Blender get them. A message says if there is no such worker. The result of Blender's export is stored.
"""

from __future__ import annotations

import hashlib
from typing import Any

import pytest

from protocol.blends import WAITS_FOR_BLENDER, blender_queue, converted_files, is_blend
from service.scheduling.incoming.messages import PrepareDone
from tests.service.conftest import TOKEN, Service, until
from tests.service.peer_worker import PeerWorker

BLEND, WRITTEN = b"BLENDER-v405", b'{"shapes": [{"type": "quad"}]}'
SHA256 = hashlib.sha256(WRITTEN).hexdigest()


def with_blender(service: Service, **options: Any) -> PeerWorker:
    """Returns a simulated worker with Blender, which returns the same export for every .blend file. options: of the worker."""
    worker = service.worker(name="blender", tags=("blender",), **options)
    worker.more = [blender_queue(worker.kind)]

    def write(scene: str) -> None:
        worker.blend = None
        if is_blend(worker.http.get(f"/api/farm/scenes/{scene}/manifest").json()["main"]):
            worker.http.put(f"/api/farm/blobs/{SHA256}", content=WRITTEN).raise_for_status()
            file = {"path": "blender-scene.yaml", "sha256": SHA256, "size": len(WRITTEN), "parts": []}
            worker.blend = {"main": "blender-scene.yaml", "files": [file]}

    worker.on_prepare = write
    return worker


def manifest(service: Service, scene: str) -> dict[str, Any]:
    answer = service.http.get(f"/api/farm/scenes/{scene}/manifest", headers={"Authorization": f"Bearer {TOKEN}"})
    found: dict[str, Any] = answer.raise_for_status().json()
    return found


@pytest.mark.long
def test_blend_is_converted_by_worker_with_blender(service: Service) -> None:
    with service.worker(name="plain", tags=()) as plain:
        scene = service.upload(BLEND, "shot.blend")
        until(lambda: service.scene(scene)["step"] == WAITS_FOR_BLENDER, "it is said", say=lambda: service.scene(scene))
        job = service.submit(scene)
        with with_blender(service):
            until(lambda: service.scene(scene)["status"] == "ready", "it is opened", say=lambda: service.scene(scene))
            assert plain.prepared == []
        found = manifest(service, scene)
        assert (found["main"], [file["sha256"] for file in found["files"]]) == ("blender-scene.yaml", [SHA256])
        service.wait_for(job, "finished")  # by the other worker, which lacks Blender
        assert service.scene(scene)["main"] == "shot.blend"

        again = service.http.post("/api/scenes", files={"files": ("shot.blend", BLEND)}, data={"environment": "sky:30,0"})
        other = again.raise_for_status().json()["id"]
        assert other != scene
        until(lambda: service.scene(other)["status"] == "ready", "it is known", say=lambda: service.scene(other))
        assert plain.prepared == [other]
        service.http.delete(f"/api/scenes/{scene}", params={"jobs": "true"})
        assert manifest(service, other)["files"] == found["files"]
        headers = {"Authorization": f"Bearer {TOKEN}"}
        assert service.http.get(f"/api/farm/blobs/{SHA256}", headers=headers).content == WRITTEN


def test_invalid_blender_export_is_rejected() -> None:
    file = {"path": "a.yaml", "sha256": SHA256, "size": 3}
    assert converted_files(None) is converted_files({"blend": None}) is None
    found = converted_files({"blend": {"main": "a.yaml", "files": [file]}})
    assert found is not None and found[1][0].sha256 == SHA256
    for wrong in ({"main": 3, "files": []}, {"main": "a", "files": 3}, {"main": "a", "files": [3]}, [1]):
        with pytest.raises(ValueError, match=r"cannot be parsed|BlobRef"):
            converted_files({"blend": wrong})
    info = {
        "kind": "k",
        "compiled": {**file, "parts": []},
        "thumbnail": None,
        "cameras": [{"name": "", "view": {}}],
        "counts": {},
        "bounds": [],
    }
    info |= {"animations": [], "warnings": [], "defaults": {}, "seconds": 0.0}
    about = {"type": "prepared", "scene": "s", "kind": "k", "worker": "w"}
    wrong_hash = {"main": "a.yaml", "files": [{**file, "sha256": "../../etc"}]}
    PrepareDone.model_validate({**about, "info": {**info, "blend": {"main": "a.yaml", "files": [file]}}})
    with pytest.raises(ValueError, match="is not a hash"):
        PrepareDone.model_validate({**about, "info": {**info, "blend": wrong_hash}})
