"""Tests of uploaded reference pictures: decoded in a child process, stored once, and returned as films.

Invalid ones are refused with error messages.
"""

from __future__ import annotations

import io
import os
import tempfile
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from PIL import Image

from protocol.pictures import FilmHead, decode_film
from renderer.image import encode, rgbe9995
from service.http.security import MAX_BODY
from service.intake import references
from service.intake.read_reference import from_srgb
from service.watching.film_picture import radiance_of
from tests.grids import grid
from tests.helpers import running_redis
from tests.service.conftest import Service

WIDTH, HEIGHT = 37, 21


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, redis_server: running_redis) -> Iterator[Service]:
    service = Service(tmp_path_factory.mktemp("references") / "data", redis_server, max_upload_bytes=3_000_000)
    yield service
    service.stop()


def radiance() -> np.ndarray:
    random = np.random.default_rng(3)
    return np.exp2(random.uniform(-8, 8, (HEIGHT, WIDTH, 3))).astype(np.float32)


def blobs(service: Service) -> int:
    return sum(each.is_file() for each in (service.options["data"] / "blobs").rglob("*"))


@pytest.mark.long
def test_reference_is_stored_as_linear_light(service: Service) -> None:
    wanted = radiance()
    wanted[0, :5] = -1.0
    file = encode.encode(wanted, "exr")
    made = service.http.post("/api/references", files={"file": ("folder/Ground truth.exr", file)})
    assert made.status_code == 201, made.text
    found = made.json()
    assert (found["name"], found["width"], found["height"], found["bytes"]) == ("Ground truth.exr", WIDTH, HEIGHT, len(file))
    assert (found["display_referred"], found["clipped"]) == (False, 5)
    again = service.http.post("/api/references", files={"file": ("other.exr", file)})
    assert again.json() == found == service.http.get(made.headers["location"]).json()
    assert service.http.get("/api/references").json() == [found]
    assert blobs(service) == 2

    words = rgbe9995.pack(wanted)
    for encoding in ("gzip", "identity"):
        answer = service.http.get(f"{made.headers['location']}/film", headers={"Accept-Encoding": encoding})
        assert answer.headers.get("content-encoding", "identity") == encoding
        film = decode_film(answer.content)
        assert (film.head, film.samples.tolist()) == (FilmHead(0, WIDTH, HEIGHT, WIDTH), [1])
        np.testing.assert_array_equal(film.words, words)
    assert service.http.get(f"{made.headers['location']}/file").content == file
    jpeg = service.http.get(f"{made.headers['location']}/image.jpg")
    assert Image.open(io.BytesIO(jpeg.content)).size == (WIDTH, HEIGHT)

    service.restart()
    assert service.http.get("/api/references").json() == [found]
    assert service.http.get(f"{made.headers['location']}/file").content == file, "the sweep at the start leaves it"
    assert service.http.delete(made.headers["location"]).status_code == 204
    assert blobs(service) == 0 and service.http.get(made.headers["location"]).status_code == 404


def test_eight_bit_reference_is_decoded_and_marked(service: Service) -> None:
    codes = np.arange(256, dtype=np.uint8).reshape(16, 16)
    out = io.BytesIO()
    Image.fromarray(np.dstack([codes] * 3)).save(out, "PNG")
    found = service.http.post("/api/references", files={"file": ("shown.png", out.getvalue())}).raise_for_status().json()
    assert (found["display_referred"], found["clipped"]) == (True, 0)
    packed = service.farm.blobs.serve(_film_of(service, found["id"])).chunks
    np.testing.assert_array_equal(radiance_of(packed), rgbe9995.unpack(rgbe9995.pack(from_srgb(np.dstack([codes] * 3)))))
    np.testing.assert_allclose(from_srgb(np.array([0, 10, 188, 255])), [0, 0.0030353, 0.5028865, 1], rtol=1e-5)
    service.http.delete(f"/api/references/{found['id']}").raise_for_status()


@pytest.mark.long
def test_reference_may_exceed_body_limit(service: Service) -> None:
    file = encode.encode(np.random.default_rng(1).uniform(0, 1, (400, 422, 3)).astype(np.float32), "exr")
    assert len(file) > MAX_BODY
    found = service.http.post("/api/references", files={"file": ("noise.exr", file)}).raise_for_status().json()
    service.http.delete(f"/api/references/{found['id']}").raise_for_status()


def test_long_name_keeps_its_suffix(service: Service) -> None:
    file = b"PF\n1 1\n-1.0\n" + np.ones(3, "<f4").tobytes()  # a format without a signature check
    found = service.http.post("/api/references", files={"file": ("n" * 240 + ".pfm", file)}).raise_for_status().json()
    assert found["name"] == "n" * 196 + ".pfm"
    service.http.delete(f"/api/references/{found['id']}").raise_for_status()


def fail_decoder(*_: Any) -> dict[str, Any]:
    """Leaves a file behind and ends its process; used in place of the decoder of reference pictures."""
    tempfile.mkdtemp()
    os._exit(1)


@pytest.mark.long
def test_files_of_failed_decoder_are_deleted(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    temporary = service.options["data"] / "tmp"
    monkeypatch.setattr(references, "as_film", fail_decoder)
    answer = service.http.post("/api/references", files={"file": ("truth.exr", encode.encode(radiance(), "exr"))})
    assert (answer.status_code, "ended without a result" in answer.json()["detail"]) == (422, True), answer.text
    assert list(temporary.iterdir()) == []


def _film_of(service: Service, id: str) -> str:
    from service.store.models import Reference

    with service.farm.sessions() as session:
        row = session.get(Reference, id)
        assert row is not None
        return str(row.film["sha256"])


@grid(
    ("name", "content", "status", "sentence"),
    [
        ("truth.exr", b"no picture at all", 422, "is not an image of a known format; give one of"),
        ("truth.exr", encode.encode(radiance(), "exr")[:700], 422, "damaged"),
        ("notes.txt", b"text", 422, "not an image that can be used as a reference"),
        ("truth.exr", b"", 422, "is empty"),
        ("truth.exr", bytes(3_100_000), 413, "3000000 bytes"),
    ],
)
def test_invalid_reference_is_rejected(service: Service, name: str, content: bytes, status: int, sentence: str) -> None:
    answer = service.http.post("/api/references", files={"file": (name, content)})
    assert (answer.status_code, sentence in answer.json()["detail"]) == (status, True), answer.text
    assert service.http.get("/api/references").json() == [] and blobs(service) == 0
