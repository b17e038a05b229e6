"""Tests of the API in general: error responses, idempotency, pictures with ETags, pagination, headers, and authorization."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
import redis
from PIL import Image

from protocol.contract import WorkerReport, worker_key
from protocol.mesh import encode_mesh
from renderer.aovs import AOVS
from renderer.image import rgbe9995
from renderer.preview_mesh import PreviewLamp, PreviewMesh
from renderer.sentences import Sentence, to_text
from renderer.settings import OPTIONAL, Tile, View
from service.models.jobs import JobIn, ViewModel
from service.store.models import Frame as FrameRow
from service.store.models import Scene as SceneRow
from tests.helpers import running_redis
from tests.service.conftest import Service, until
from tests.service.peer_worker import expected_sums


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis) -> Iterator[Service]:
    service = Service(tmp_path_factory.mktemp("api") / "data", redis_server, max_pixels=1 << 20)
    with service.worker():
        service.ready_scene()
        yield service
    service.stop()


@pytest.fixture(scope="module")
def scene(service: Service) -> str:
    return str(service.http.get("/api/scenes").json()[0]["id"])


@pytest.fixture(scope="module")
def job(service: Service, scene: str) -> str:
    job = service.submit(scene)
    service.wait_for(job, "finished")
    return job


def problem(answer: Any, status: int) -> dict[str, Any]:
    assert answer.status_code == status, answer.text
    assert answer.headers["content-type"] == "application/problem+json"
    body: dict[str, Any] = answer.json()
    assert body["status"] == status
    assert body["type"] == "about:blank"
    assert body["title"]
    assert body["detail"].endswith(".")
    return body


@pytest.mark.long
def test_still_has_its_noise(service: Service, scene: str) -> None:
    """The noise of a still in the API equals the last noise value of its history, and is stored in the database.

    A loop in docs/python.md uses this noise to decide when to stop.
    """
    job = service.submit(scene, spp=16)
    service.wait_for(job, "finished")
    noise = service.job(job)["frames"][0]["noise"]
    assert noise == service.http.get(f"/api/jobs/{job}/history").json()["points"][-1]["noise"] > 0
    assert service.http.get(f"/api/jobs/{job}/frames/0").json()["noise"] == noise
    with service.farm.sessions() as session:
        assert session.get_one(FrameRow, (job, 0)).noise == noise


def test_scene_thumbnail_has_etag(service: Service, scene: str) -> None:
    """A thumbnail has an ETag, since the front page requests all thumbnails whenever it is opened."""
    writer = service.farm.blobs.writer()
    writer.write(b"a picture")
    sha256 = writer.commit()
    with service.farm.sessions.begin() as session:
        row = session.get_one(SceneRow, scene)
        row.info = {**(row.info or {}), "thumbnail": {"sha256": sha256, "size": writer.size}}
    url = f"/api/scenes/{scene}/thumbnail.png"
    first = service.http.get(url)
    assert (first.status_code, first.content, first.headers["cache-control"]) == (200, b"a picture", "no-cache")
    again = service.http.get(url, headers={"If-None-Match": first.headers["etag"]})
    assert (again.status_code, again.content, again.headers["etag"]) == (304, b"", first.headers["etag"])
    assert service.http.get(url, headers={"If-None-Match": '"another"'}).content == b"a picture"


def test_preview_of_an_earlier_layout_is_not_found(service: Service, scene: str) -> None:
    """The page draws only the current layout: a mesh that an earlier release stored counts as missing."""
    packet = encode_mesh(
        PreviewMesh(np.eye(3), np.zeros((3, 3), np.float32), np.zeros((3, 4), np.uint8), np.array([[0, 1, 2]], np.uint32))
    )
    url = f"/api/scenes/{scene}/preview"
    for content, status in [(packet, 200), (bytes([1]) + packet[1:], 404), (b"", 404)]:
        writer = service.farm.blobs.writer()
        writer.write(content)
        sha256 = writer.commit()
        with service.farm.sessions.begin() as session:
            row = session.get_one(SceneRow, scene)
            row.info = {**(row.info or {}), "preview": {"sha256": sha256, "size": writer.size}}
        assert service.http.get(url).status_code == status
        assert service.http.get(url, headers={"If-None-Match": f'"{sha256}"'}).status_code == (304 if status == 200 else 404)


def test_light_of_a_preview_is_that_of_the_scene_that_a_view_has_prepared(service: Service, scene: str) -> None:
    """Presets without a sun are known at once; a sky once its scene has a preview that is not one of the scene's own light."""
    sun = PreviewLamp((0.0, 1.0, 0.0), True, (1.0, 1.0, 1.0))
    sky = np.linspace(0.1, 1.0, 2 * 4 * 3, dtype=np.float32).reshape(2, 4, 3)
    one = PreviewMesh(np.zeros((1, 3)), np.zeros((1, 3), np.float32), np.zeros((1, 4), np.uint8), np.zeros((0, 3), np.uint32))
    url = f"/api/scenes/{scene}/preview-light"

    def store(id: str, mesh: PreviewMesh, missing: int = 0) -> None:
        writer = service.farm.blobs.writer()
        packet = encode_mesh(mesh)
        writer.write(packet[: len(packet) - missing])
        ref = {"path": "", "sha256": writer.commit(), "size": writer.size, "parts": []}
        with service.farm.sessions.begin() as session:
            row = session.get_one(SceneRow, id)
            row.info = {**(row.info or {}), "preview": ref}

    studio = service.http.get(url, params={"preset": "studio"}).json()
    assert (studio["width"], studio["height"], studio["lamps"]) == (128, 64, [])
    problem(service.http.get(url, params={"preset": "moon"}), 422)
    problem(service.http.get(url, params={"image": "1"}), 422)
    problem(service.http.get("/api/scenes/1/preview-light", params={"preset": "studio"}), 404)
    asked = {"elevation": 30, "azimuth": 60}
    assert service.http.get(url, params=asked).json() is None
    lit = service.farm.lighting.row(scene, {"environment": {"sky": asked}}).id
    store(scene, one)
    store(lit, one)
    assert service.http.get(url, params=asked).json() is None
    store(lit, one._replace(environment=sky, lamps=(sun,)))
    found = service.http.get(url, params=asked).json()
    words = np.frombuffer(base64.b64decode(found["words"]), "<u4").reshape(2, 4)
    np.testing.assert_allclose(rgbe9995.unpack(words), sky, atol=2e-3)
    assert found["lamps"] == [{**sun._asdict(), "at": [0, 1, 0], "color": [1, 1, 1], "axis": [0, 0, 0], "cosines": [-2, -1]}]
    store(lit, one._replace(environment=sky), missing=9)
    assert service.http.get(url, params=asked).json() is None


def test_long_url_is_not_echoed(service: Service) -> None:
    assert len(problem(service.http.get(f"/{'a' * 5000}/end"), 404)["detail"]) < 500


@pytest.mark.parametrize(
    ("change", "field", "says"),
    [
        ({"width": 0}, "width", "greater than or equal to 1"),
        ({"width": "wide"}, "width", "integer"),
        ({"width": 20000}, "width", "less than or equal"),
        ({"width": 4096, "height": 4096}, "width", "at most"),
        ({"spp": 0}, "spp", "greater"),
        ({"spp": 1 << 21}, "spp", "less"),
        ({"noise": -1}, "noise", "greater"),
        ({"seconds": 0}, "seconds", "greater"),
        ({"frame": -1}, "frame", "-1 is not a frame; give a number from 0 to 10000000, in steps of a half"),
        ({"frame": 1.25}, "frame", "1.25 is not a frame"),
        ({"frame": 1e300}, "frame", "1e+300 is not a frame"),
        ({"frames": "24-1"}, "frames", "the range 24-1 ends before it begins"),
        ({"camera": "nowhere"}, "camera", "0: front, 1: overview"),
        ({"camera": "²"}, "camera", "0: front, 1: overview"),
        ({"camera": "9" * 1000}, "camera", "0: front, 1: overview"),
        ({"camera": "9" * 1001}, "camera", "at most 1000 characters"),
        ({"camera": 7}, "camera", "counted from 0"),
        ({"camera": "7"}, "camera", "counted from 0"),
        ({"camera": -1}, "camera", "a number from 0"),
        ({"camera": 10**9}, "camera", "a number from 0"),
        ({"camera": ["front"]}, "camera", "a camera is a name"),
        ({"camera": "front", "view": {"eye": [0, 0, 1], "target": [0, 0, 0]}}, "", "give only one of camera, view"),
        ({"view": {"eye": [0, 0, 0], "target": [0, 0, 0]}}, "view", "same point"),
        ({"view": {"eye": [0, 0], "target": [0, 0, 0]}}, "view.eye[2]", "required"),
        ({"view": {"eye": [0, 1e999, 0], "target": [0, 0, 0]}}, "view.eye[1]", ""),
        ({"integrator": "magic"}, "integrator", "known are path"),
        ({"max_depth": 0}, "max_depth", "greater"),
        ({"sampler": "dice"}, "sampler", "known are sobol"),
        ({"filter": "fir"}, "filter", "known are blackman-harris"),
        ({"sampling": "all"}, "sampling", "known are mis"),
        ({"roulette": 0.01}, "roulette", "lies between 0.05 and 1"),
        ({"roulette_floor": 1}, "roulette_floor", "less"),
        ({"heuristic": "maximum"}, "heuristic", "known are power"),
        ({"light_choice": "luck"}, "light_choice", "known are tree"),
        ({"clamp_indirect": -1}, "clamp_indirect", "greater"),
        ({"light_samples": 0}, "light_samples", "greater"),
        ({"ao_distance": -1}, "ao_distance", "greater"),
        ({"view": {"eye": [0, 0, 1], "target": [0, 0, 0], "projection": "fish"}}, "view.projection", "known are perspective"),
        ({"view": {"eye": [0, 0, 1], "target": [0, 0, 0], "aperture": -1}}, "view.aperture", "greater"),
        ({"view": {"eye": [0, 0, 1], "target": [0, 0, 0], "focus": 0}}, "view.focus", "greater"),
        ({"view": {"eye": [0, 0, 1], "target": [0, 0, 0], "height": 0}}, "view.height", "greater"),
        ({"seed": -1}, "seed", "greater"),
        ({"environment": {"sky": {"elevation": 91}}}, "environment.sky.elevation", "less"),
        ({"environment": {"sky": {"elevation": 9}, "color": [1, 1, 1]}}, "environment", "give only one of color, sky"),
        ({"environment": {"preset": "candle"}}, "environment.preset", "the presets are studio"),
        ({"environment": {"image": "x", "preset": "studio"}}, "environment", "give only one of image, preset"),
        ({"environment": {"rotation": 361}}, "environment.rotation", "less"),
        ({"environment": {"color": [1, 2]}}, "environment.color[2]", "required"),
        ({"priority": 1000}, "priority", "less"),
        ({"priority": True}, "priority", "true or false"),
        ({"seed": False}, "seed", "true or false"),
        ({"camera": True}, "camera", "true or false"),
        ({"view": {"eye": [True, 0, 1], "target": [0, 0, 0]}}, "view.eye", "true or false"),
        ({"name": "a\0b"}, "name", "control characters"),
        ({"name": "a\r\nb"}, "name", "line breaks"),
        ({"name": "\ud800"}, "name", "string"),
        ({"integrator": "x" * 5000}, "integrator", " ... "),
        ({"camera": "9" * 1000}, "camera", "the scene has"),
        ({"spp": 10**400}, "spp", "less"),
        ({"tile_size": 1}, "tile_size", "greater"),
        ({"sps": 64}, "sps", "no such field"),
    ],
)
def test_invalid_field_is_named_in_error(service: Service, scene: str, change: dict[str, Any], field: str, says: str) -> None:
    body = json.dumps({"scene": scene, **change}).replace("Infinity", "1e999")
    found = problem(service.http.post("/api/jobs", content=body, headers={"content-type": "application/json"}), 422)
    assert field in [error["field"] for error in found["errors"]]
    assert says in found["detail"]


def test_every_renderer_setting_can_be_requested(service: Service, scene: str) -> None:
    view = {"eye": [0, 0, 9], "target": [0, 0, 0], "up": [0, 1, 0], "fov": 20, "projection": "orthographic"}
    view |= {"aperture": 0.5, "focus": 3.0, "height": 4.0, "near": 1.0}
    asked = {"integrator": "direct", "sampler": "independent", "filter": "tent", "sampling": "light", "clamp_indirect": 9.0}
    asked |= {"roulette": 0.5, "light_samples": 4, "ao_distance": 2.0, "max_depth": 5, "seed": 6}
    view = {name: value for name, value in view.items() if name in {field.name for field in fields(View)}}
    job = service.job(service.submit(scene, view=view, **asked))
    assert job["settings"]["view"] == view
    assert {name: job["settings"][name] for name in asked} == asked
    assert set(OPTIONAL) <= set(JobIn.model_fields), "a setting of the renderer is not in the API"
    assert {field.name for field in fields(View)} == set(ViewModel.model_fields)


def test_all_errors_are_problem_json(service: Service) -> None:
    assert "/api/scenes" in problem(service.http.post("/api/jobs", json={"scene": "nothing"}), 404)["detail"]
    for path in ("/api/jobs/nothing", "/api/scenes/nothing", "/api/jobs/nothing/frames/0/image.png", "/nowhere", "/api/nowhere"):
        problem(service.http.get(path), 404)
    problem(service.http.put("/api/jobs"), 405)
    problem(service.http.post("/api/jobs", content=b"{", headers={"content-type": "application/json"}), 422)
    problem(service.http.post("/api/jobs", content=b"x" * (2 << 20)), 413)
    chunks = (b"x" * 65536 for _ in range(32))
    problem(service.http.post("/api/jobs", content=chunks, headers={"content-type": "application/json"}), 413)
    problem(service.http.post("/api/jobs", content=b'{"scene": "\xff"}', headers={"content-type": "application/json"}), 400)
    problem(service.http.get("/api/jobs", params={"limit": "many"}), 422)


@pytest.mark.parametrize(
    ("body", "kind", "says"),
    [
        (b"", "application/json", "the body is not a JSON object"),
        (b"null", "application/json", "the body is not a JSON object"),
        (b"{}", "text/plain", "Content-Type: application/json"),
        (b"{x", "application/json", "the body is not JSON ("),
    ],
)
def test_body_must_be_json_object(service: Service, body: bytes, kind: str, says: str) -> None:
    answer = service.http.post("/api/jobs", content=body, headers={"content-type": kind})
    assert says in problem(answer, 422)["detail"]


def test_malicious_body_gets_short_error(service: Service) -> None:
    def refused(body: bytes, status: int) -> None:
        answer = service.http.post("/api/jobs", content=body, headers={"content-type": "application/json"})
        problem(answer, status)
        assert len(answer.content) < 50_000

    refused(b'{"scene":' + b"[" * 100_000 + b"]" * 100_000 + b"}", 400)
    refused(b'{"scene": "x", "spp": ' + b"9" * 5000 + b"}", 400)
    refused(json.dumps({f"field{i}": 1 for i in range(20_000)}).encode(), 422)
    refused(json.dumps({"x" * 500_000: 1}).encode(), 422)
    refused(b'{"scene": "x", "\\ud800": 1}', 422)


def test_head_requests_are_supported(service: Service, job: str) -> None:
    for path in ("/healthz", f"/api/jobs/{job}", f"/api/jobs/{job}/frames/0/image.png"):
        head, get = service.http.head(path), service.http.get(path)
        assert (head.status_code, head.headers["content-type"]) == (200, get.headers["content-type"])
        assert head.content == b""
    assert service.http.head("/api/jobs/nope").status_code == 404


def test_repeated_idempotency_key_creates_one_job(service: Service, scene: str) -> None:
    request = {"scene": scene, "width": 16, "height": 16, "spp": 1}
    headers = {"Idempotency-Key": "a key"}
    first = service.http.post("/api/jobs", json=request, headers=headers)
    again = service.http.post("/api/jobs", json=request, headers=headers)
    assert (first.status_code, again.status_code) == (201, 201)
    assert first.json()["id"] == again.json()["id"]
    assert again.headers["idempotent-replayed"] == "true"
    problem(service.http.post("/api/jobs", json={**request, "spp": 2}, headers=headers), 409)
    for odd in ("k" * 256, "schlüssel"):
        answer = service.http.post("/api/jobs", json=request, headers={"Idempotency-Key": odd.encode("latin-1")})
        assert "idempotency-key" in problem(answer, 422)["detail"]
    ids = [each["id"] for each in service.http.get("/api/jobs").json()]
    assert ids.count(first.json()["id"]) == 1


def test_pictures_equal_film(service: Service, job: str) -> None:
    url = f"/api/jobs/{job}/frames/0"
    sums = expected_sums(Tile(0, 0, 64, 48), 0, 8, 0)
    mean = sums[0:3].astype(np.float64) / (1 << 24) / 8
    shown = np.asarray(Image.open(io.BytesIO(service.http.get(f"{url}/image.png?tonemap=srgb").content)))
    assert shown.shape == (48, 64, 3)
    encoded = np.where(mean <= 0.0031308, 12.92 * mean, 1.055 * mean ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(shown, np.moveaxis(encoded, 0, -1) * 255, atol=1.0)
    darker = np.asarray(Image.open(io.BytesIO(service.http.get(f"{url}/image.png?tonemap=srgb&exposure=-2").content)))
    assert darker.mean() < shown.mean()
    magic = {"exr": b"\x76\x2f\x31\x01", "hdr": b"#?RADIANCE", "jpg": b"\xff\xd8\xff", "png": b"\x89PNG"}
    for extension, start in magic.items():
        assert service.http.get(f"{url}/image.{extension}").content.startswith(start)
    assert "set deep" in problem(service.http.get(f"{url}/deep.exr"), 422)["detail"]
    words = np.frombuffer(service.http.get(f"{url}/image.rgb9e5").content, "<u4").reshape(48, 64)
    np.testing.assert_array_equal(words, rgbe9995.pack(np.moveaxis(mean, 0, -1).astype(np.float32)))
    problem(service.http.get(f"{url}/image.png?tonemap=magic"), 422)
    problem(service.http.get(f"{url}/image.bmp"), 422)
    problem(service.http.get(f"/api/jobs/{job}/frames/3/image.png"), 404)
    problem(service.http.get(f"{url}/pixel?x=64&y=0"), 422)


@pytest.mark.long
def test_every_aov_can_be_downloaded(service: Service, job: str, tmp_path: Path) -> None:
    url = f"/api/jobs/{job}/frames/0"
    normal = np.asarray(Image.open(io.BytesIO(service.http.get(f"{url}/image.png?aov=normal").content)))
    assert (normal[..., 2] == 255).all()
    for aov in AOVS:
        for extension in ("png", "jpg", "exr", "hdr"):
            assert service.http.get(f"{url}/image.{extension}?aov={aov}").status_code == 200, (aov, extension)
    depth, names = exr(service.http.get(f"{url}/image.exr?aov=depth").content, tmp_path)
    assert names == ["R", "G", "B"]
    assert (depth == 2.0).all()
    layers, names = exr(service.http.get(f"{url}/image.exr?aov=all").content, tmp_path)
    assert {"R", "Denoising Albedo.R", "Normal.Z", "Depth.Z", "Position.X", "IndexOB.X", "IndexMA.X"} <= set(names)
    assert (layers[..., names.index("Debug Sample Count.X")] == 8).all()
    assert (layers[..., names.index("Normal.Z")] == 1).all()
    two, names = exr(service.http.get(f"{url}/image.exr?aov=color,depth").content, tmp_path)
    assert set(names) == {"R", "G", "B", "Depth.Z"}
    np.testing.assert_array_equal(two[..., :3], exr(service.http.get(f"{url}/image.exr").content, tmp_path)[0])
    pixel = service.http.get(f"{url}/pixel?x=5&y=6").json()
    assert (pixel["depth"], pixel["normal"], pixel["samples"]) == (2.0, [0, 0, 1], 8)
    assert (pixel["object"], pixel["object_name"], pixel["material"]) == (None, None, None)
    assert pixel["error"] > 0
    assert "known are albedo" in problem(service.http.get(f"{url}/image.png?aov=mood"), 422)["detail"]
    assert "image.exr" in problem(service.http.get(f"{url}/image.png?aov=all"), 422)["detail"]
    assert "colour only" in problem(service.http.get(f"{url}/image.rgb9e5?aov=normal"), 422)["detail"]


def exr(content: bytes, folder: Path) -> tuple[np.ndarray, list[str]]:
    (folder / "picture.exr").write_bytes(content)
    file = oiio.ImageInput.open(str(folder / "picture.exr"))
    try:
        names = list(file.spec().channelnames)
        return file.read_image(), names
    finally:
        file.close()


def test_unchanged_picture_gives_304(service: Service, job: str) -> None:
    url = f"/api/jobs/{job}/frames/0/image.png"
    tag = service.http.get(url).headers["etag"]
    for known in (tag, f'W/{tag}, "other"', "*"):
        assert service.http.get(url, headers={"If-None-Match": known}).status_code == 304
    assert service.http.get(url, headers={"If-None-Match": '"other"'}).status_code == 200
    assert service.http.get(url, params={"exposure": 1}, headers={"If-None-Match": tag}).status_code == 200


@pytest.mark.long
def test_openapi_names_tone_curves(service: Service, job: str) -> None:
    """The curves are named in the description: `tonemap` also takes OpenColorIO views, so it has no list of allowed values."""
    paths = service.http.get("/openapi.json").json()["paths"]
    parameters = paths["/api/jobs/{id}/frames/{n}/image.{extension}"]["get"]["parameters"]
    (described,) = (each["description"] for each in parameters if each["name"] == "tonemap")
    curves = service.http.get("/api/info").json()["curves"]
    assert ", ".join(curves) in described
    for curve in curves:
        assert service.http.get(f"/api/jobs/{job}/frames/0/image.png", params={"tonemap": curve}).status_code == 200


def test_lists_are_paginated_and_filtered(service: Service, scene: str, job: str) -> None:
    answer = service.http.get("/api/jobs", params={"limit": 1, "state": "finished", "scene": scene})
    assert len(answer.json()) == 1
    assert int(answer.headers["x-total-count"]) >= 1
    assert service.http.get("/api/jobs", params={"scene": "other"}).json() == []
    assert service.http.get("/api/scenes", params={"offset": 100}).json() == []


def test_invalid_changes_are_rejected(service: Service, job: str) -> None:
    for change in ({"state": "paused"}, {"state": "cancelled"}, {"spp": 1}):
        problem(service.http.patch(f"/api/jobs/{job}", json=change), 409)
    for change in ({"state": "finished"}, {"spp": 9, "more": 1}, {"more": 0}, {"more": 1 << 20}):
        problem(service.http.patch(f"/api/jobs/{job}", json=change), 422)
    problem(service.http.patch("/api/jobs/nothing", json={}), 404)
    problem(service.http.delete("/api/jobs/nothing"), 404)


def test_pages_have_security_headers(service: Service) -> None:
    for path in ("/docs/", "/docs/docs.js", "/openapi.json", "/api/info"):
        answer = service.http.get(path)
        assert answer.status_code == 200, path
        assert "default-src 'self'" in answer.headers["content-security-policy"]
        assert answer.headers["x-content-type-options"] == "nosniff"
    page = service.http.get("/docs", follow_redirects=True)
    assert page.url.path == "/docs/"
    assert "//" not in page.text.replace("</", ""), "the page loads nothing from elsewhere"
    assert service.http.get("/docs/", headers={"If-None-Match": page.headers["etag"]}).status_code == 304
    assert service.http.get("/docs/docs.js").headers["content-type"].startswith("text/javascript")
    assert service.http.get("/docs/../../service/main.py").status_code == 404
    assert service.http.get("/docs/%2e%2e/main.py").status_code == 404


def test_foreign_origins_and_hosts_are_rejected(service: Service) -> None:
    problem(service.http.post("/api/jobs", json={}, headers={"Origin": "https://elsewhere.example"}), 403)
    problem(service.http.get("/api/jobs", headers={"Host": "elsewhere.example"}), 421)
    assert service.http.get("/api/jobs", headers={"Origin": "https://elsewhere.example"}).status_code == 200
    own = service.http.post("/api/jobs", json={}, headers={"Origin": service.url})
    problem(own, 422)


def test_health_and_metrics(service: Service, job: str) -> None:
    until(lambda: service.http.get("/readyz").status_code == 200, "the service is ready")
    assert service.http.get("/healthz").status_code == 200
    text = service.http.get("/metrics").text
    assert 'rayfarm_jobs{state="finished"}' in text
    assert 'rayfarm_worker_slots{worker="peer"} 2.0' in text
    merged = next(line for line in text.splitlines() if line.startswith("rayfarm_batches_merged_total"))
    assert float(merged.split()[1]) > 0


def test_workers_are_listed(service: Service) -> None:
    (worker,) = service.http.get("/api/workers").json()
    assert (worker["name"], worker["slots"], worker["state"]) == ("peer", 2, "ready")
    assert (worker["cards"], worker["cards_unused"]) == ([], [])


def test_worker_is_listed_with_graphics_cards(service: Service) -> None:
    card = {"number": 0, "name": "RTX Test", "memory": 8 << 30, "capability": "8.6", "slot": 1, "samples_per_s": 2.5e8}
    reason = Sentence("cards-none-found", "No graphics card is used: the NVIDIA driver finds none.")
    report = WorkerReport("gpu", "host", 1, 2, "cpu", "kind", "ready", 0.0, cards=[card], cards_unused=[to_text(reason), "plain"])
    with redis.Redis.from_url(service.options["redis_url"]) as store:
        store.set(worker_key("gpu"), report.to_bytes(), ex=60)
        until(lambda: len(service.http.get("/api/workers").json()) == 2, "both workers are listed")
        worker = next(each for each in service.http.get("/api/workers").json() if each["name"] == "gpu")
        store.delete(worker_key("gpu"))
    assert worker["cards"] == [card]
    assert worker["cards_unused"] == [str(reason), "plain"]
    assert worker["codes"]["cards_unused"] == [{"code": "cards-none-found", "params": {}}, None]
