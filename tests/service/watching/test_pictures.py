"""Tests of pictures made from a film in horizontal bands: they equal those made from the whole frame.

Making them uses no more memory than estimated.
"""

from __future__ import annotations

import io
import tracemalloc
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import BinaryIO, cast

import numpy as np
import OpenImageIO as oiio  # noqa: N813 -- the name its own documentation uses
import pytest
from PIL import Image

from protocol.sums import pack_sums
from renderer import aovs
from renderer import film as film_math
from renderer.image import rgbe9995, tonemap
from renderer.image.encode import encode
from service.store.films import Contribution, Film
from service.store.tile_cache import TileCache
from service.watching.pictures import PictureRequest, display_picture, picture_file, picture_memory
from tests.grids import grid
from tests.service.peer_worker import expected_sums

WIDTH, HEIGHT, TILE = 1100, 900, 128
EXR = b"\x76\x2f\x31\x01"
ALL = PictureRequest("exr", tuple(aovs.AOVS), in_layers=True)
WISHES = [
    *(PictureRequest(extension) for extension in ("png", "jpg", "exr", "hdr", "rgb9e5")),
    *(PictureRequest(extension, width=300) for extension in ("png", "exr", "rgb9e5")),
    *(PictureRequest(extension, exposure=1.0) for extension in ("avif", "jxl")),
    *(PictureRequest("png", (name,)) for name in aovs.AOVS),
    *(PictureRequest("exr", (name,)) for name in ("normal", "depth")),
    PictureRequest("png", ("error",), width=300),
    PictureRequest("jpg", visible=True),
    ALL,
]


def rendered(folder: Path, width: int, height: int, tile: int, exponent: int = 24) -> Film:
    film = Film(folder / "job.sqlite", width, height, tile, exponent, TileCache(1))
    film.merge([Contribution(0, i, 0, 2, pack_sums(expected_sums(tile, 0, 2, 0))) for i, tile in enumerate(film.tiles)])
    return film


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Film]:
    film = rendered(tmp_path_factory.mktemp("film"), WIDTH, HEIGHT, TILE)
    yield film
    film.close()


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Film]:
    """Yields a film with 1/4 of the large film's width, height and tile size, and with as many bands.

    It is small enough to compare every value.
    """
    film = rendered(tmp_path_factory.mktemp("film"), WIDTH // 4, HEIGHT // 4, TILE // 4)
    yield film
    film.close()


@pytest.fixture(scope="module")
def sums(small: Film) -> np.ndarray:
    whole = np.zeros((20, small.height, small.width), np.int64)
    for tile in small.tiles:
        whole[:, tile.y : tile.y + tile.h, tile.x : tile.x + tile.w] = expected_sums(tile, 0, 2, 0)
    return whole


def made(film: Film, wish: PictureRequest, folder: Path) -> bytes:
    return b"".join(picture_file(film, 0, wish, folder).pieces())


def is_same_picture(data: bytes, other: bytes, folder: Path) -> bool:
    """Returns whether two files have the same channels and values; metadata such as the creation time may differ."""
    read = []
    for content in (data, other):
        path = folder / f"read{'.exr' if content.startswith(EXR) else '.hdr'}"
        path.write_bytes(content)
        file = oiio.ImageInput.open(str(path))
        read.append((file.spec().channelnames, file.read_image(format=oiio.FLOAT)))
        file.close()
    return read[0][0] == read[1][0] and np.array_equal(read[0][1], read[1][1])


def decoded(data: bytes) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(data)))


@pytest.mark.long
def test_banded_pictures_equal_whole_frame(small: Film, sums: np.ndarray, tmp_path: Path) -> None:
    color = film_math.mean(sums, 24)
    for extension in ("exr", "hdr"):
        assert is_same_picture(made(small, PictureRequest(extension), tmp_path), encode(color, extension), tmp_path)
    np.testing.assert_array_equal(decoded(made(small, PictureRequest("png", exposure=1), tmp_path)), tonemap.apply(color, 1))
    assert made(small, PictureRequest("rgb9e5"), tmp_path) == rgbe9995.pack(color).astype("<u4").tobytes()
    planes = {name: aovs.values(sums, 24, name) for name in aovs.AOVS}
    assert is_same_picture(made(small, ALL, tmp_path), encode(color, "exr", channels=aovs.layers(planes)), tmp_path)
    for name, plane in planes.items():
        np.testing.assert_array_equal(decoded(made(small, PictureRequest("png", (name,)), tmp_path)), aovs.visible(name, plane))
        grey = plane if plane.ndim == 3 else np.repeat(plane[..., None], 3, axis=2)
        assert is_same_picture(made(small, PictureRequest("exr", (name,)), tmp_path), encode(grey, "exr"), tmp_path)


def test_visible_option_exposes_dark_picture(small: Film, tmp_path: Path) -> None:
    """A film 2^-16 times as bright looks black. A bright picture stays as it is."""
    dark = rendered(tmp_path, small.width, small.height, small.tiles[0].w, 40)
    black, shown = (decoded(made(dark, PictureRequest("png", visible=visible), tmp_path)) for visible in (False, True))
    dark.close()
    assert black.max() < 20 < 100 < shown.max()
    plain, same_again = (made(small, PictureRequest("png", visible=visible), tmp_path) for visible in (False, True))
    assert plain == same_again
    exposed = [made(small, PictureRequest("png", exposure=2.0, visible=visible), tmp_path) for visible in (False, True)]
    assert exposed[0] == exposed[1], "a picture that its exposure shows"


@pytest.mark.long
def test_downscaled_copy_has_minimum_width(film: Film, tmp_path: Path) -> None:
    assert decoded(made(film, PictureRequest("png", width=300), tmp_path)).shape == (300, 366, 3)
    (tmp_path / "small.exr").write_bytes(made(film, PictureRequest("exr", width=300), tmp_path))
    small = oiio.ImageInput.open(str(tmp_path / "small.exr"))
    assert (small.spec().width, small.spec().height) == (366, 300)
    small.close()


def test_denoised_picture_is_read_in_bands(small: Film, tmp_path: Path) -> None:
    color = np.random.default_rng(5).random((small.height, small.width, 3), np.float32)
    wish = PictureRequest("exr", denoised=lambda: io.BytesIO(color.astype("<f4").tobytes()))
    assert is_same_picture(made(small, wish, tmp_path), encode(color, "exr"), tmp_path)


def peak_memory(film: Film, wish: PictureRequest, folder: Path) -> int:
    """Returns the bytes that Python holds at most while it makes a picture."""
    tracemalloc.start()
    try:
        picture_file(film, 0, wish, folder)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@grid("wish", WISHES, ids=lambda wish: f"{wish.extension}-{'+'.join(wish.planes)}-{wish.width}")
def test_memory_estimate_is_not_exceeded(film: Film, small: Film, wish: PictureRequest, tmp_path: Path) -> None:
    picture_file(small, 0, wish, tmp_path)  # warms up imports and caches
    assert peak_memory(film, wish, tmp_path) < picture_memory(film, wish)


@pytest.mark.long
def test_memory_estimate_includes_denoised_light_groups(film: Film, tmp_path: Path) -> None:
    """A band of 40 light groups takes 34 MB, many times as much as a band of one colour."""
    dark = nullcontext(cast(BinaryIO, SimpleNamespace(read=bytes)))  # of any length
    wish = PictureRequest("exr", denoised=lambda: cast(BinaryIO, dark), lights=40, gains=((1.0, 1.0, 1.0),) * 40)
    assert picture_memory(film, replace(wish, lights=0)) < peak_memory(film, wish, tmp_path) < picture_memory(film, wish)


def test_radiance_file_memory_is_independent_of_height(film: Film) -> None:
    higher = Film(Path("none"), WIDTH, 10 * HEIGHT, TILE, 24, TileCache(1))
    for wish in (PictureRequest("exr"), PictureRequest("hdr"), ALL):
        assert picture_memory(higher, wish) == picture_memory(film, wish)


def test_denoised_light_groups_are_mixed_as_they_are_read() -> None:
    """A file of denoised light groups has, for each row of pixels, the rows of all groups."""
    size = SimpleNamespace(width=5, height=130, is_transparent=False)  # more rows than are read at once
    lights = np.random.default_rng(1).random((2, size.height, size.width, 3), np.float32)
    gains = ((2.0, 1.0, 0.5), (0.0, 0.25, 1.0))
    stored = np.stack([*lights], axis=1).tobytes()
    request = PictureRequest("png", denoised=lambda: io.BytesIO(stored), lights=2, gains=gains, curve="srgb")
    mixed = np.asarray(gains[0], np.float32) * lights[0] + np.asarray(gains[1], np.float32) * lights[1]
    shown = display_picture(cast(Film, size), 0, request)
    assert np.abs(shown.astype(int) - tonemap.apply(mixed, 0.0, "srgb").astype(int)).max() <= 1
