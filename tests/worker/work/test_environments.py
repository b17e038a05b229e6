"""Tests of environment images: which are accepted, the error messages for those that are not, and the thumbnails."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813
import pytest
from PIL import Image

from protocol.contract import BlobRef, ShowEnvironment
from renderer.image import encode
from renderer.presets import PRESETS
from scenes import light_pictures
from worker.machine.status import SlotBoard
from worker.reading.environments import small_picture
from worker.work.derived_artifacts import ENVIRONMENTS


def image(path: Path, pixels: np.ndarray) -> Path:
    file = oiio.ImageOutput.create(str(path))
    file.open(str(path), oiio.ImageSpec(pixels.shape[1], pixels.shape[0], 3, "float"))
    file.write_image(pixels.astype(np.float32))
    file.close()
    return path


@pytest.fixture
def make_thumbnail(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Returns a function that makes an image file's thumbnail. It returns the worker's event and the thumbnail's bytes."""
    stored: list[bytes] = []

    def store(path: Path) -> BlobRef:
        stored.append(path.read_bytes())
        return BlobRef("", "0" * 64, len(stored[-1]))

    def show(path: Path) -> tuple[dict[str, Any], list[bytes]]:
        worker: Any = SimpleNamespace(name="w", link=SimpleNamespace(store=store), board=SlotBoard(1))
        worker.cache = SimpleNamespace(path=lambda sha256, size: path)
        work = ShowEnvironment("work", "id", path.name, "0" * 64, path.stat().st_size, 64)
        task = SimpleNamespace(request=SimpleNamespace(delivery_info={}))
        return ENVIRONMENTS.event(task, worker, asdict(work)), stored

    return show


@pytest.mark.long
def test_environment_thumbnail_is_small(make_thumbnail: Any, tmp_path: Path) -> None:
    event, stored = make_thumbnail(image(tmp_path / "sky.exr", np.full((16, 32, 3), 7.0)))
    assert (event["type"], event["work"]) == ("environment-shown", "work"), event
    assert stored[0][:2] == b"\xff\xd8", "a JPEG"


@pytest.mark.parametrize(
    ("pixels", "says"),
    [(np.ones((16, 16, 3)), "twice as wide as high"), (np.zeros((8, 16, 3)), "black"), (None, "damaged")],
)
def test_unusable_environment_is_rejected(make_thumbnail: Any, tmp_path: Path, pixels: Any, says: str) -> None:
    path = tmp_path / "sky.exr"
    if pixels is None:
        path.write_bytes(b"v/1\x01 is not all that it takes")
    else:
        image(path, pixels)
    event, stored = make_thumbnail(path)
    assert event["type"] == "environment-failed"
    assert event["error"].startswith(("sky.exr: ", "sky.exr "))
    assert says in event["error"]
    assert not stored


def test_bright_lamp_does_not_darken_thumbnail() -> None:
    pixels = np.full((64, 128, 3), 0.01, np.float32)
    plain = small_picture(pixels, 32)
    pixels[10, 10] = 1e6
    lit = small_picture(pixels, 32)
    np.testing.assert_allclose(np.median(lit), np.median(plain), rtol=0.1)
    assert lit.shape == (16, 32, 3)
    assert small_picture(np.ones((2, 4, 3), np.float32), 32).shape == (16, 32, 3)


@pytest.mark.long
def test_shipped_thumbnails_match_presets(tmp_path: Path) -> None:
    assert {path.stem for path in light_pictures.FOLDER.glob("*.jpg")} == set(PRESETS)
    for name in PRESETS:
        encode.write(tmp_path / "now.jpg", small_picture(light_pictures.radiance(name), light_pictures.WIDTH))
        now, kept = (np.asarray(Image.open(path), int) for path in (tmp_path / "now.jpg", light_pictures.FOLDER / f"{name}.jpg"))
        assert np.abs(now - kept).mean() < 2, f"{name}: python -m scenes.light_pictures"


def test_shipped_radiance_is_that_of_the_presets() -> None:
    with np.load(light_pictures.RADIANCE) as kept:
        assert {*kept.files} == {name for name, preset in PRESETS.items() if preset.sky is None}
        for name in kept.files:
            np.testing.assert_array_equal(kept[name], light_pictures.table(name), err_msg="python -m scenes.light_pictures")
