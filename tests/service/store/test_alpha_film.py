"""Tests that films with a transparent background store their alpha, and that pictures of the colour have it."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813 -- the name its own documentation uses
import pytest
from PIL import Image

from protocol.sums import pack_sums
from renderer import aovs, film
from renderer.film import COLOR, SAMPLES, Sums, alpha_plane, group_planes, plane_count
from renderer.image import tonemap
from service.store.bands import digest
from service.store.films import Contribution, Film
from service.store.tile_cache import TileCache
from service.watching.pictures import PictureRequest, picture_file

WIDTH, HEIGHT, TILE, COUNT = 40, 24, 16, 3
GROUPS = ("key", "rest")
ONE = 1 << 24
ALPHA = alpha_plane(len(GROUPS))


def batch(w: int, h: int, seed: int) -> Sums:
    """Returns random sums of a tile with two light groups and an alpha, whose colour is premultiplied."""
    random = np.random.default_rng(seed)
    sums = np.zeros((plane_count(2, True), h, w), np.int64)
    sums[ALPHA] = random.integers(0, COUNT + 1, (h, w)) * ONE
    sums[ALPHA + 1] = (COUNT * ONE - sums[ALPHA]) * random.integers(0, 2, (h, w))  # on a shadow catcher
    sums[ALPHA + 2] = random.integers(0, 1 << 20, (h, w)) * (sums[ALPHA + 1] > 0)
    sums[ALPHA + 3] = sums[ALPHA + 2] * random.random((h, w))
    for k in range(2):
        sums[group_planes(k)] = random.integers(0, 1 << 20, (3, h, w)) * (sums[ALPHA] // ONE)
    sums[COLOR] = sums[group_planes(0)] + sums[group_planes(1)]
    sums[SAMPLES] = COUNT
    return sums


@pytest.fixture
def made(tmp_path: Path) -> Iterator[tuple[Film, Sums]]:
    """Yields a film with an alpha, and its sums."""
    found = Film(tmp_path / "job.sqlite", WIDTH, HEIGHT, TILE, 24, TileCache(1 << 20), groups=GROUPS, is_transparent=True)
    whole = np.zeros((plane_count(2, True), HEIGHT, WIDTH), np.int64)
    for i, tile in enumerate(found.tiles):
        sums = batch(tile.w, tile.h, i)
        whole[:, tile.y : tile.y + tile.h, tile.x : tile.x + tile.w] += sums
        assert found.merge([Contribution(0, i, 0, COUNT, pack_sums(sums))]) == [True]
    yield found, whole
    found.close()


def picture(found: Film, folder: Path, wish: PictureRequest) -> bytes:
    wish.check()
    return b"".join(picture_file(found, 0, wish, folder).pieces())


def exr_channels(data: bytes, folder: Path) -> dict[str, np.ndarray]:
    (folder / "p.exr").write_bytes(data)
    source = oiio.ImageInput.open(str(folder / "p.exr"))
    names, pixels = list(source.spec().channelnames), source.read_image(format="float")
    assert source.spec().alpha_channel == 3
    return {name: pixels[..., k] for k, name in enumerate(names)}


def test_pictures_have_the_alpha_of_the_film(made: tuple[Film, Sums], tmp_path: Path) -> None:
    found, whole = made
    assert digest(found, 0, tmp_path) == film.digest(whole)
    color, alpha = film.mean(whole, 24), film.alpha(whole, 24, len(GROUPS))
    assert not color[alpha == 0].any()
    assert color[alpha > 0].any()
    for wish, others in (
        (PictureRequest("exr"), []),
        (PictureRequest("exr", ("alpha", "depth", "light:key"), in_layers=True), ["Depth.Z", "Combined_key.R"]),
        (PictureRequest("exr", gains=((1, 1, 1), (1, 1, 1))), []),
    ):
        channels = exr_channels(picture(found, tmp_path, wish), tmp_path)
        assert [*channels][:4] == ["R", "G", "B", "A"]
        assert {*others} <= {*channels}
        np.testing.assert_array_equal(channels["A"], alpha)
        np.testing.assert_array_equal(np.stack([channels[c] for c in "RGB"], axis=-1), color)
    png = Image.open(io.BytesIO(picture(found, tmp_path, PictureRequest("png", exposure=1))))
    np.testing.assert_array_equal(np.asarray(png), tonemap.apply_straight(color, alpha, 1))
    jpg = Image.open(io.BytesIO(picture(found, tmp_path, PictureRequest("jpg"))))
    assert jpg.mode == "RGB"
    grey = Image.open(io.BytesIO(picture(found, tmp_path, PictureRequest("png", ("alpha",)))))
    np.testing.assert_array_equal(np.asarray(grey)[..., 0], (alpha * 255 + 0.5).astype(np.uint8))
    small = Image.open(io.BytesIO(picture(found, tmp_path, PictureRequest("png", width=20))))
    assert (small.mode, small.size) == ("RGBA", (20, 12))


def test_denoised_pictures_have_the_alpha_of_the_film(made: tuple[Film, Sums], tmp_path: Path) -> None:
    found, whole = made
    clean = np.random.default_rng(1).random((HEIGHT, WIDTH, 3), np.float32)
    wish = PictureRequest("exr", denoised=lambda: io.BytesIO(clean.tobytes()))
    channels = exr_channels(picture(found, tmp_path, wish), tmp_path)
    np.testing.assert_array_equal(np.stack([channels[c] for c in "RGB"], axis=-1), clean)
    np.testing.assert_array_equal(channels["A"], film.alpha(whole, 24, len(GROUPS)))


def test_snapshots_of_films_know_the_alpha(made: tuple[Film, Sums]) -> None:
    found, whole = made
    with found.snapshot() as snapshot:
        assert snapshot.is_transparent
        tile = found.tiles[1]
        planes = aovs.planes("alpha", GROUPS)
        sums = snapshot.tile_planes(0, 1, planes)
        assert sums is not None
        part = slice(tile.y, tile.y + tile.h), slice(tile.x, tile.x + tile.w)
        np.testing.assert_array_equal(sums[ALPHA:], whole[ALPHA:, *part])
