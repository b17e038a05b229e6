"""Tests of deep pictures: sums by depth are exact in any order, the samples flatten to the picture, and merging holds out.

Files are read by OpenImageIO, which also composites them, with OpenEXR's own code.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import OpenImageIO as oiio  # noqa: N813 -- the name its own documentation uses
import pytest

from protocol.sums import PACKED, check_sums, check_weight, merge_deep, pack_sums, unpack_deep, unpack_hits, unpack_sums
from renderer import deep as deep_module
from renderer import film as film_math
from renderer import render
from renderer.cryptomatte import count_samples
from renderer.deep import COUNT, FAR, LIGHT, SUMS, Deep, binned, merged, moved, no_deep, pixels_of
from renderer.deep_samples import CHANNELS, DeepRows, deep_rows
from renderer.film import COLOR, SAMPLES
from renderer.image.deep_exr import write_deep
from renderer.kernel import accumulate
from renderer.render import RenderStats, is_for_cards, render_batch, render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.description import Environment, Instance, Material, Medium, SceneDescription, Sphere
from renderer.settings import RenderSettings, Tile, View, tiles_of
from tests.renderer.builders import gray, square
from tests.renderer.test_cryptomatte import described

SPP = 32
SETTINGS = RenderSettings(30, 20, View((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), fov=45.0), deep=8)


def rendered(scene: SceneDescription, settings: RenderSettings, spp: int = SPP) -> tuple[np.ndarray, Deep, DeepRows]:
    """Returns the sums of a frame, its deep pixels, and the samples of its deep picture."""
    stats = RenderStats()
    sums = render_frame(compile_scene(scene), settings, spp, stats=stats)
    assert stats.deep is not None
    groups = len(settings.light_planes)
    return sums, stats.deep, deep_rows(stats.deep, sums, settings.film_exponent, groups, settings.is_transparent)


def picture_of(path: Path, rows: DeepRows) -> oiio.ImageBuf:
    """Writes a deep picture in two bands, and returns it as OpenImageIO reads it."""
    height, width = rows.count.shape
    split, half = int(rows.count[: height // 2].sum()), height // 2
    bands = [DeepRows(rows.count[:half], rows.values[:split]), DeepRows(rows.count[half:], rows.values[split:])]
    write_deep(path, bands, width, height)
    found = oiio.ImageBuf(str(path))
    assert found.read() and found.deep, found.geterror()
    assert sorted(found.spec().channelnames) == list(CHANNELS)
    assert found.spec().getattribute("openexr:maxSamplesPerPixel") in (None, int(rows.count.max()))
    return found


def flat(picture: oiio.ImageBuf) -> tuple[np.ndarray, np.ndarray]:
    """Returns the colour and the alpha of a deep picture, composited by OpenImageIO."""
    made = oiio.ImageBufAlgo.flatten(picture)
    pixels, names = made.get_pixels(oiio.FLOAT), list(made.spec().channelnames)
    return np.stack([pixels[..., names.index(c)] for c in "RGB"], -1), pixels[..., names.index("A")]


def by_pixel(deep: Deep, column: int, shape: tuple[int, int]) -> np.ndarray:
    found = np.zeros(shape[0] * shape[1], np.int64)
    np.add.at(found, pixels_of(deep), deep.sums[:, column])
    return found.reshape(shape)


def assert_equal(one: Deep, other: Deep) -> None:
    for name, a, b in zip(Deep._fields, one, other, strict=True):
        np.testing.assert_array_equal(a, b, err_msg=name)


@pytest.mark.parametrize("background", ["visible", "transparent"])
def test_samples_flatten_to_the_picture(background: str, tmp_path: Path) -> None:
    """A wall, a half transparent veil and balls: sums equal the film's integers, and the file its colour and alpha."""
    settings = replace(SETTINGS, background=background)
    sums, deep, rows = rendered(described(), settings)
    shape = sums.shape[1:]
    assert np.array_equal(render_frame(compile_scene(described()), replace(settings, deep=0), SPP), sums)
    for k in range(3):
        assert np.array_equal(by_pixel(deep, LIGHT.start + k, shape), sums[COLOR][k])
    count = by_pixel(deep, COUNT, shape)
    alpha = film_math.alpha(sums, 24, 0) if settings.is_transparent else np.ones(shape, np.float32)
    assert np.array_equal(count, sums[SAMPLES]) == (background == "visible")
    assert rows.count.max() == settings.deep, "no pixel has many depths"
    file = picture_of(tmp_path / "d.exr", rows)
    color, found = flat(file)
    np.testing.assert_allclose(color, film_math.mean(sums, 24), atol=1e-6)
    np.testing.assert_allclose(found, alpha, atol=1e-6)
    at = np.concatenate([[0], np.cumsum(rows.count)])
    z, back = rows.values[:, 4], rows.values[:, 5]
    for first, end in pairwise(at):
        assert (z[first:end][1:] > back[first:end][:-1]).all(), "samples are in order and do not overlap"
    assert (back == FAR).any() == (background == "visible")


def balls(*which: str) -> SceneDescription:
    """Returns unlit balls, which do not light each other: red at the left, green at the right and in part behind it."""
    colors = {"red": ((1.0, 0.0, 0.0), (-0.5, 0.0, 0.3)), "green": ((0.0, 1.0, 0.0), (0.5, 0.1, 0.0))}
    spheres = [Sphere(colors[name][1], 1.4, k, name) for k, name in enumerate(which)]
    materials = [Material(name, "unlit", base_color=colors[name][0]) for name in which]
    return SceneDescription(spheres=spheres, materials=materials, environment=Environment(gray(0.3)))


def test_pictures_rendered_apart_hold_each_other_out(tmp_path: Path) -> None:
    """Two balls that intersect, each rendered alone and merged, equal both rendered together."""
    settings = replace(SETTINGS, background="transparent", deep=32)
    rows = [rendered(balls(name), settings)[2] for name in ("red", "green")]
    parts = [picture_of(tmp_path / f"{k}.exr", each) for k, each in enumerate(rows)]
    color, alpha = flat(oiio.ImageBufAlgo.deep_merge(*parts))
    sums = rendered(balls("red", "green"), settings)[0]
    expected, covered = film_math.mean(sums, 24), film_math.alpha(sums, 24, 0)
    is_shared = (flat(parts[0])[1] == 1) & (flat(parts[1])[1] == 1)
    (red_near, red_far), (green_near, green_far) = map(depths, rows)
    for is_before, channel in ((red_far < green_near, 0), (green_far < red_near, 1)):
        at = is_shared & is_before
        assert at.sum() > 5, "each ball is in front somewhere"
        assert (expected[at][:, channel] == 1).all()
        np.testing.assert_allclose(color[at], expected[at], atol=1e-6)
    assert np.sqrt(((color - expected) ** 2).mean()) < 0.01
    assert np.sqrt(((alpha - covered) ** 2).mean()) < 0.005  # at edges, the parts' coverages are taken as independent


def depths(rows: DeepRows) -> tuple[np.ndarray, np.ndarray]:
    """Returns the least and the greatest depth of each pixel; infinite where it is empty."""
    near, far = np.full(rows.count.size, np.inf), np.full(rows.count.size, np.inf)
    pixel = np.repeat(np.arange(rows.count.size), rows.count.reshape(-1))
    first, last = np.searchsorted(pixel, np.unique(pixel)), np.searchsorted(pixel, np.unique(pixel), "right") - 1
    near[pixel[first]], far[pixel[last]] = rows.values[first, 4], rows.values[last, 5]
    return near.reshape(rows.count.shape), far.reshape(rows.count.shape)


def test_depth_is_measured_along_the_line_of_sight(tmp_path: Path) -> None:
    """A wall that faces the camera has one depth; in a panorama depths are distances."""
    wall = SceneDescription(
        meshes=[square((0.0, 0.0, -1.0), (9.0, 0.0, 0.0), (0.0, 9.0, 0.0), 0)],
        instances=[Instance(0)],
        materials=[Material("wall", base_color=gray(0.5))],
        environment=Environment(gray(0.5)),
    )
    rows = rendered(wall, SETTINGS, 4)[2]
    assert (rows.count == 1).all()
    np.testing.assert_allclose(rows.values[:, 4:], 6.0, rtol=1e-6)
    around = replace(SETTINGS, view=View((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), projection="panorama"))
    values = rendered(wall, around, 4)[2].values
    seen = values[values[:, 5] < FAR]
    assert seen[:, 4].min() == pytest.approx(6.0, rel=0.02)
    assert seen[:, 5].max() > 8


@pytest.mark.parametrize("size", [7, 16])
def test_deep_pixels_do_not_depend_on_batches(size: int, monkeypatch: pytest.MonkeyPatch) -> None:
    scene, stats = compile_scene(described()), RenderStats()
    whole = render_frame(scene, SETTINGS, 6, stats=stats, threads=1)
    assert stats.deep is not None
    monkeypatch.setattr("renderer.render._DEEP_AT_ONCE", size * size * 2)  # batches of 3 are divided
    work = [(tile, first, count) for tile in tiles_of(30, 20, size) for first, count in ((0, 1), (1, 2), (3, 3))]
    parts = []
    for k in np.random.default_rng(size).permutation(len(work)):
        tile, first, count = work[k]
        batch = render_batch(scene, SETTINGS, tile, first, count)
        assert batch.deep is not None and (batch.sums[SAMPLES] == count).all()
        parts.append(moved(batch.deep, tile.x, tile.y, tile.w, 30))
    assert_equal(merged(parts), stats.deep)
    assert film_math.digest(whole, deep=stats.deep) != film_math.digest(whole)


def random_deep(seed: int, pixels: int, samples: int, most: int) -> list[Deep]:
    """Returns the deep pixels of random samples, each alone."""
    random = np.random.default_rng(seed)
    depth = np.exp(random.uniform(-2, 2, (samples, pixels))).astype(np.float32)
    depth[random.random(depth.shape) < 0.2] = FAR
    sums = random.integers(-(1 << 40), 1 << 40, (samples, pixels, SUMS))
    sums[..., COUNT] = 1
    return [binned(most, np.arange(pixels), depth[k], sums[k]) for k in range(samples)]


@pytest.mark.parametrize(("seed", "pixels", "samples", "most"), [(0, 1, 1, 4), (1, 3, 12, 4), (2, 5, 9, 6), (3, 4, 40, 5)])
def test_deep_pixels_add_up_in_any_order(seed: int, pixels: int, samples: int, most: int) -> None:
    """Equal to a brute-force sum at the least level at which the bins of each pixel are few enough; also after packing."""
    parts = random_deep(seed, pixels, samples, most)
    whole = merged(parts)
    expected = {}
    for pixel in range(pixels):
        bins = [int(part.key[pixel]) & 0xFFFFFF for part in parts]
        level = next(level for level in range(19) if len({b >> level for b in bins}) <= most)
        for part, number in zip(parts, bins, strict=True):
            key = pixel << 32 | level << 24 | number >> level
            expected.setdefault(key, []).append((part.sums[pixel], part.near[pixel], part.far[pixel]))
    assert whole.key.tolist() == sorted(expected)
    for k, key in enumerate(whole.key.tolist()):
        sums, near, far = zip(*expected[key], strict=True)
        assert whole.sums[k].tolist() == np.sum(sums, axis=0).tolist()
        assert (whole.near[k], whole.far[k]) == (min(near), max(far))
    order = np.random.default_rng(seed).permutation(samples)
    cut = samples // 2
    halves = [merged([parts[k] for k in half]) for half in (order[:cut], order[cut:]) if len(half)]
    assert_equal(merged(halves), whole)
    tile, planes = Tile(0, 0, pixels, 1), np.zeros((film_math.CHANNELS, 1, pixels), np.int64)
    planes[SAMPLES] = samples
    hits = count_samples(np.ones((pixels, samples, 2), np.uint32)) if seed % 2 else None
    packed = pack_sums(planes, PACKED, hits, whole)
    check_weight(packed, tile, samples)
    np.testing.assert_array_equal(unpack_sums(packed, tile), planes)
    unpacked, both = unpack_deep(packed, tile), merge_deep([pack_sums(planes, deep_pixels=half) for half in halves], tile)
    assert unpacked is not None and both is not None
    assert_equal(unpacked, whole)
    assert_equal(both, whole)
    found = unpack_hits(packed, tile)
    assert found is not None and len(found.key) == (0 if hits is None else 2 * pixels)
    assert unpack_deep(pack_sums(planes, hits=hits), tile) is None


def test_damaged_deep_pixels_are_rejected() -> None:
    tile, sums = Tile(0, 0, 2, 2), np.zeros((film_math.CHANNELS, 2, 2), np.int64)
    sums[SAMPLES] = 3
    good = merged(random_deep(1, 4, 3, 4))
    data = pack_sums(sums, deep_pixels=good)
    check_weight(data, tile, 3)
    one = merged(random_deep(1, 4, 3, 1))
    for deep, said in ((one, "3 samples, but the batch has 2"), (good, "not in order")):
        with pytest.raises(ValueError, match=said):
            check_weight(pack_sums(np.zeros_like(sums), deep_pixels=deep), tile, 2)
    check_weight(data, tile, 3, deep_samples=good.most)
    for packed, wanted in ((data, 0), (data, 8), (pack_sums(sums), good.most)):
        with pytest.raises(ValueError, match="deep samples a pixel at most"):
            check_weight(packed, tile, 3, deep_samples=wanted)
    none = good.sums.copy()
    none[0, COUNT] = 0
    wrong = [
        good._replace(key=good.key[::-1].copy()),
        good._replace(key=good.key + np.uint64(4 << 32)),
        good._replace(key=good.key | np.uint64(19 << 24)),
        good._replace(key=good.key | np.uint64(1 << 23)),
        good._replace(sums=none),
        good._replace(near=good.far * 2),
        good._replace(far=good.far * np.float32(np.nan)),
        good._replace(most=1),
    ]
    for deep in wrong:
        with pytest.raises(ValueError, match="not in order"):
            check_sums(pack_sums(sums, deep_pixels=deep), tile)
    for end in range(len(data)):
        with pytest.raises(ValueError, match="sums"):
            check_sums(data[:end], tile)
    with pytest.raises(ValueError, match="follows"):
        check_sums(data + b"\0", tile)
    check_sums(pack_sums(sums, deep_pixels=no_deep(8)), tile)


def test_shadow_catchers_cover_as_much_as_in_the_picture(tmp_path: Path) -> None:
    """Their alpha is a ratio of sums over the pixel; a holdout leaves nothing."""
    scene = balls("red")
    scene.materials.append(Material("floor", base_color=gray(0.5), shadow_catcher=True))
    scene.materials.append(Material("hole", base_color=gray(0.5), holdout=True))
    scene.meshes.append(square((0.0, -0.8, 0.0), (4.0, 0.0, 0.0), (0.0, 0.0, -4.0), 1))
    scene.instances.append(Instance(0))
    scene.spheres.append(Sphere((1.2, 0.0, 1.0), 0.5, 2, "hole"))
    sums, _, rows = rendered(scene, replace(SETTINGS, background="transparent", view=View((0, 2, 5), (0, 0, 0), fov=45)))
    alpha = film_math.alpha(sums, 24, 0)
    assert ((alpha > 0.05) & (alpha < 0.95)).sum() > 20
    assert (rows.count == 0).sum() > 5
    color, found = flat(picture_of(tmp_path / "d.exr", rows))
    np.testing.assert_allclose(found, alpha, atol=1e-6)
    np.testing.assert_allclose(color, film_math.mean(sums, 24), atol=1e-6)


def test_cards_render_deep_pictures() -> None:
    assert is_for_cards(SETTINGS)
    assert deep_module.MOST_DEEP == 64


@pytest.mark.long
@pytest.mark.parametrize("background", ["visible", "transparent"])
def test_both_backends_record_the_same_samples(background: str, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = replace(SETTINGS, background=background, cryptomatte=4)
    sums, deep, _ = rendered(described(), settings, 4)
    monkeypatch.setattr(render, "renderer_of", lambda *_: accumulate._render_special_path)
    monkeypatch.setattr(render, "has_variants", lambda _: False)
    again, other, _ = rendered(described(), settings, 4)
    np.testing.assert_array_equal(again, sums)
    assert_equal(other, deep)


@pytest.mark.long
def test_fog_has_the_alpha_of_its_thickness(tmp_path: Path) -> None:
    """Scattering fog before a wall: what deep samples up to a depth let through is exp(-density x depth)."""
    density = 0.25
    scene = SceneDescription(
        meshes=[square((0.0, 0.0, -1.0), (9.0, 0.0, 0.0), (0.0, 9.0, 0.0), 0)],
        instances=[Instance(0)],
        materials=[Material("wall", base_color=gray(0.5))],
        environment=Environment(gray(0.5)),
        medium=Medium(sigma_s=gray(density)),
    )
    narrow = replace(SETTINGS, view=View((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), fov=5.0), deep=64)
    sums, _, rows = rendered(scene, narrow, 128)
    color, alpha = flat(picture_of(tmp_path / "d.exr", rows))
    np.testing.assert_allclose(color, film_math.mean(sums, 24), atol=1e-6)
    np.testing.assert_allclose(alpha, 1, atol=1e-6)
    ends = np.cumsum(rows.count)
    for depth in (1.0, 3.0, 5.9):
        left = [np.prod(1 - values[values[:, 5] < depth, 0]) for values in np.split(rows.values, ends[:-1])]
        assert abs(np.mean(left) - np.exp(-density * depth)) < 0.02
