"""Tests of /api/examples: shipped example scenes can be opened like uploads."""

from __future__ import annotations

import errno
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from renderer.scene.studio import NO_LIGHTS_WARNING
from scenes import example_pictures
from service.store.models import Scene
from service.store.staging import BlobWriter
from tests.service.conftest import Service, until


def test_example_equals_its_upload(service: Service) -> None:
    examples = {example["name"]: example for example in service.http.get("/api/examples").json()}
    box = examples["cornell-box"]
    assert box["title"] == "Cornell box" and box["description"].endswith(".") and box["scenes"] == []

    opened = service.http.post("/api/examples/cornell-box")
    assert opened.status_code == 201 and opened.json()["name"] == box["title"]
    path: Path = service.farm.settings.examples / "cornell-box.yaml"
    uploaded = service.http.post("/api/scenes", files={"files": (path.name, path.read_bytes())})
    assert uploaded.json()["id"] == opened.json()["id"]


def test_lit_scene_is_the_same_with_and_without_automatic_floor(service: Service) -> None:
    """The command line and the page ask for a floor where a file has no light; curl and the examples ask for none."""

    def upload(text: bytes, **fields: str) -> dict[str, Any]:
        answer = service.http.post("/api/scenes", data=fields, files={"files": ("lit.yaml", text)}).raise_for_status()
        found: dict[str, Any] = answer.json()
        until(lambda: service.scene(found["id"])["status"] == "ready", "it is prepared")
        return found

    with service.worker():
        for text, first, second in ((b"# 1", {}, {"floor": "auto"}), (b"# 2", {"floor": "auto"}, {})):
            found = upload(text, **first)
            assert upload(text, **second)["id"] == found["id"]
            assert upload(text, floor="on")["id"] != found["id"]
            assert upload(text, environment="overcast")["id"] != found["id"]
            with service.farm.sessions.begin() as session:
                scene = session.get(Scene, found["id"])
                assert scene is not None and scene.info is not None
                scene.info = {**scene.info, "warnings": [NO_LIGHTS_WARNING]}
            assert upload(text, **second)["id"] != found["id"], "it has a floor, or might have one"


def test_scenes_that_may_be_unlit_at_times_are_not_taken_as_equal(service: Service) -> None:
    """Another frame or variant without light would have the automatic floor. A scene that exists answers its own upload."""
    for number, info in enumerate(({"clips": [{"name": "fade"}]}, {"variants": ["night"]}, {})):
        files = {"files": ("lit.yaml", f"# at times {number}".encode())}
        found = service.http.post("/api/scenes", files=files).json()["id"]
        with service.farm.sessions.begin() as session:
            scene = session.get(Scene, found)
            assert scene is not None
            scene.status, scene.info = "ready", {"warnings": [], **info}
        other = service.http.post("/api/scenes", data={"floor": "auto"}, files=files).json()["id"]
        assert (other == found) == (not info)
        assert service.http.post("/api/scenes", files=files).json()["id"] == found


def test_example_includes_all_its_files(service: Service) -> None:
    opened = service.http.post("/api/examples/christmas")
    assert opened.status_code == 201 and opened.json()["name"] == "Christmas"
    folder: Path = service.farm.settings.examples / "christmas"
    files = [("files", (f"christmas/{path.name}", path.read_bytes())) for path in folder.iterdir()]
    uploaded = service.http.post("/api/scenes", files=files)
    assert uploaded.json()["id"] == opened.json()["id"]
    known = {example["name"]: example for example in service.http.get("/api/examples").json()}
    assert known["christmas"]["scenes"] == [opened.json()["id"]] and known["cornell-box"]["scenes"] == []
    assert known["christmas"]["description"].startswith("A village in the snow")
    assert list(known) == sorted(known)


def test_animated_example_has_frames(service: Service) -> None:
    known = {example["name"]: example for example in service.http.get("/api/examples").json()}
    assert (known["caterpillar"]["frames"], known["caterpillar"]["fps"]) == ("0-95", 24)
    assert known["cornell-box"]["frames"] is None and known["cornell-box"]["fps"] is None


def test_failed_example_leaves_no_files(service: Service, monkeypatch: pytest.MonkeyPatch) -> None:
    """If the disk becomes full at the third file of an example, nothing of the example remains."""
    written: list[bytes] = []

    def write(self: BlobWriter, data: bytes) -> None:
        if len(written) == 2:
            raise OSError(errno.ENOSPC, "No space left on device")
        written.append(data)

    before = sorted(path for path in service.farm.settings.data.rglob("*") if path.is_file())
    monkeypatch.setattr(BlobWriter, "write", write)
    answer = service.http.post("/api/examples/christmas")
    assert answer.status_code == 507
    assert sorted(path for path in service.farm.settings.data.rglob("*") if path.is_file()) == before


def test_unknown_example_is_404(service: Service) -> None:
    answer = service.http.post("/api/examples/teapot")
    assert answer.status_code == 404
    assert answer.json()["detail"].startswith("There is no example 'teapot'.")


def test_examples_have_sharp_pictures_in_the_shape_of_their_scenes() -> None:
    """The page shows them before the scene's view: another shape would jump, a small one would be blurred."""
    scenes = [*example_pictures.SCENES.glob("*.yaml"), *example_pictures.SCENES.glob("*/*.yaml")]
    pictures = {scene: example_pictures.PICTURES / f"{scene.stem}.jpg" for scene in scenes}
    for scene, path in pictures.items():
        width, height = example_pictures.size_of(scene)
        with Image.open(path) as picture:
            assert picture.width >= 560, path.name
            assert picture.width / picture.height == pytest.approx(width / height, rel=0.01), path.name
    assert sum(path.stat().st_size for path in pictures.values()) < 1.5e6, "the front page loads them all"
