"""Tests that films add up light groups, Cryptomatte's counts and deep pixels exactly, and that files and digests have them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813 -- the name its own documentation uses
import pytest

from protocol.sums import pack_sums
from renderer import cryptomatte, deep, film
from renderer.aovs import parse_names
from renderer.cryptomatte import Hits, count_samples, merged, moved
from renderer.deep import Deep
from renderer.deep_samples import deep_rows
from renderer.film import COLOR, SAMPLES, Sums, group_planes, plane_count
from renderer.image.deep_exr import write_deep
from renderer.sentences import Sentence
from service.errors import Invalid
from service.store.bands import bands, digest
from service.store.films import Contribution, Film
from service.store.tile_cache import TileCache
from service.watching.deep_picture import deep_picture
from service.watching.mix import gains_of_mix
from service.watching.pictures import PictureRequest, picture_file

WIDTH, HEIGHT, TILE, COUNT = 40, 24, 16, 3
GROUPS = ("key", "rest")
NAMES = {"objects": ["cup", "saucer", "spoon"], "materials": ["china"]}


DEEP = 4


def deep_batch(w: int, h: int, seed: int) -> Deep:
    """Returns random deep pixels of a tile, of COUNT samples each."""
    random = np.random.default_rng(seed)
    sums = random.integers(0, 1 << 20, (w * h * COUNT, deep.SUMS))
    sums[:, deep.COUNT], sums[:, deep.UNCOVERED] = 1, 0
    return deep.binned(DEEP, np.repeat(np.arange(w * h), COUNT), random.uniform(1, 2, len(sums)).astype(np.float32), sums)


def batch(w: int, h: int, seed: int) -> tuple[Sums, Hits]:
    """Returns random sums of a tile with two light groups that add up to the colour, and random counts."""
    random = np.random.default_rng(seed)
    sums = random.integers(0, 1 << 26, (plane_count(2), h, w))
    sums[COLOR] = sums[group_planes(0)] + sums[group_planes(1)]
    sums[SAMPLES] = COUNT
    return sums, count_samples(random.integers(0, 4, (w * h, COUNT, 2)).astype(np.uint32))


@pytest.mark.parametrize("order", [0, 1])
def test_film_stores_light_groups_cryptomatte_and_deep_pixels(order: int, tmp_path: Path) -> None:
    made = Film(tmp_path / "job.sqlite", WIDTH, HEIGHT, TILE, 24, TileCache(1 << 20), groups=GROUPS, ranks=2, deep=DEEP)
    whole, hits, depths = np.zeros((plane_count(2), HEIGHT, WIDTH), np.int64), [], []
    parts = []
    for i, tile in enumerate(made.tiles):
        for k in range(12):  # enough that the film folds its rows
            sums, of_tile = batch(tile.w, tile.h, 100 * i + k)
            whole[:, tile.y : tile.y + tile.h, tile.x : tile.x + tile.w] += sums
            hits.append(moved(of_tile, tile.x, tile.y, tile.w, WIDTH))
            deep_pixels = deep_batch(tile.w, tile.h, 100 * i + k)
            depths.append(deep.moved(deep_pixels, tile.x, tile.y, tile.w, WIDTH))
            parts.append(Contribution(0, i, COUNT * k, COUNT, pack_sums(sums, hits=of_tile, deep_pixels=deep_pixels)))
    for at in np.random.default_rng(order).permutation(len(parts)):
        assert made.merge([parts[at]]) == [True]
    expected = film.digest(whole, merged(hits), deep.merged(depths))
    assert digest(made, 0, tmp_path) == expected
    planes = parse_names(["lights", "cryptomatte"], GROUPS, 2)
    wish = PictureRequest("exr", tuple(planes), in_layers=True, names_of_ids=NAMES)
    wish.check()
    body = picture_file(made, 0, wish, tmp_path)
    (tmp_path / "p.exr").write_bytes(b"".join(body.pieces()))
    source = oiio.ImageInput.open(str(tmp_path / "p.exr"))
    names, pixels = list(source.spec().channelnames), source.read_image(format="float")
    channel = {name: pixels[..., k] for k, name in enumerate(names)}
    for k, group in enumerate(GROUPS):
        mean = film.mean(whole, 24, group_planes(k))
        for c, letter in enumerate("RGB"):
            np.testing.assert_array_equal(channel[f"Combined_{group}.{letter}"], mean[..., c])
    layers = cryptomatte.layers(merged(hits), whole[SAMPLES], 2, NAMES)
    for k, name in enumerate(cryptomatte.channel_names(2)):
        np.testing.assert_array_equal(channel[name], layers[..., k], err_msg=name)
    rows = deep_rows(deep.merged(depths), whole, 24, 2, is_transparent=False)
    assert rows.count.max() == DEEP
    write_deep(tmp_path / "expected.exr", [rows], WIDTH, HEIGHT)
    assert b"".join(deep_picture(made, 0, tmp_path).pieces()) == (tmp_path / "expected.exr").read_bytes()
    with made.snapshot() as snapshot:
        assert snapshot.groups == GROUPS
        np.testing.assert_array_equal(snapshot.tile_hits(0, 1).key, made.tile_hits(0, 1).key)
    made.close()


def test_cryptomatte_is_exported_to_exr_only() -> None:
    for wish in (
        PictureRequest("png", ("cryptomatte:6",)),
        PictureRequest("exr", ("cryptomatte:6",)),
        PictureRequest("exr", ("cryptomatte:6",), in_layers=True, width=100),
    ):
        with pytest.raises(Invalid, match="cryptomatte"):
            wish.check()


def test_a_mix_is_the_weighted_sum_of_its_groups(tmp_path: Path) -> None:
    """Gains of 1 give the bits of the colour; a gain of 0 leaves a group out; a triple weighs red, green and blue."""
    made = Film(tmp_path / "job.sqlite", WIDTH, HEIGHT, TILE, 24, TileCache(1 << 20), groups=GROUPS, ranks=2)
    for i, tile in enumerate(made.tiles[1:], 1):  # the first tile has no samples
        sums, hits = batch(tile.w, tile.h, i)
        assert made.merge([Contribution(0, i, 0, COUNT, pack_sums(sums, hits=hits))]) == [True]

    def picture(*names: str, mix: str = "") -> np.ndarray:
        return np.concatenate([*bands(made, 0, names, gains=gains_of_mix(mix, GROUPS))])

    colour, key, rest = picture("color"), picture("light:key"), picture("light:rest")
    assert colour.any() and not colour[:TILE, :TILE].any()
    assert np.array_equal(picture("color", mix="key:1"), colour)
    assert np.array_equal(picture("color", mix="key:0"), rest)
    assert np.array_equal(picture("color", mix="key:0, rest:2"), 2 * rest)
    weighed = key * np.array([0.5, 1, 4], np.float32) + rest * np.float32(0.25)
    assert np.allclose(picture("color", mix="key:0.5/1/4,rest:0.25"), weighed, rtol=1e-6)


@pytest.mark.parametrize(
    ("mix", "code"),
    [
        ("window:1", "mix-group-unknown"),
        ("key", "mix-gain-invalid"),
        ("key:-1", "mix-gain-invalid"),
        ("key:1/2", "mix-gain-invalid"),
        ("key:nan", "mix-gain-invalid"),
        ("key:65537", "mix-gain-invalid"),
    ],
)
def test_a_mix_of_unknown_groups_or_gains_is_refused(mix: str, code: str) -> None:
    with pytest.raises(Invalid) as refused:
        gains_of_mix(mix, GROUPS)
    assert isinstance(refused.value.fact, Sentence) and refused.value.fact.code == code
    with pytest.raises(Invalid, match="no light groups"):
        gains_of_mix("key:1", ())
