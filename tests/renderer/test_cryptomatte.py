"""Tests of Cryptomatte: mattes equal brute-force coverage, counts add up in any order, and files follow the specification.

The decoder here is written from the specification alone (Psyop, Cryptomatte 1.2.0), not from renderer/cryptomatte.py.
"""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio  # noqa: N813 -- the name its own documentation uses
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.sums import PACKED, check_sums, check_weight, merge_hits, pack_sums, unpack_hits, unpack_sums
from renderer import cryptomatte
from renderer import film as film_math
from renderer.cryptomatte import NOT_FINITE, Hits, channel_names, count_samples, hash_of, header, layers, merged, moved
from renderer.film import COLOR, SAMPLES
from renderer.image import encode
from renderer.render import RenderStats, render_batch, render_frame
from renderer.scene.compile import compile_scene, summarise
from renderer.scene.description import Environment, Instance, Material, SceneDescription, Sphere
from renderer.settings import RenderSettings, Tile, View, tiles_of
from tests.renderer.builders import gray, square

SPP = 32
SETTINGS = RenderSettings(30, 20, View((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), fov=45.0), cryptomatte=6)
NAMES = ["wall", "veil", "ball A", "ball B", "Zwölf", "tiny 0", "tiny 1", "tiny 2", "tiny 3", "tiny 4", "tiny 5", "tiny 6"]


def described(shining: int | None = None) -> SceneDescription:
    """Returns a wall, a half transparent veil and balls, of which several share a pixel.

    shining: everything is unlit and black, except for the object and material of this number, which is white: the picture is then
    their coverage.
    """

    def material(number: int, **more: Any) -> Material:
        if shining is None:
            return Material(f"stuff {number}", base_color=gray(0.5), **more)
        return Material(f"stuff {number}", "unlit", base_color=gray(float(number == shining)), **more)

    veil = {"opacity": 0.4, "alpha_mode": "blend"}
    at = [(-0.8, 0.2, 0.5), (-0.1, 0.3, 0.7), (0.9, -0.5, 0.2)]
    spheres = [Sphere(place, 0.55, 2 + k, NAMES[2 + k]) for k, place in enumerate(at)]
    spheres += [Sphere((0.4 + 0.1 * (k % 3), 0.7 + 0.1 * (k // 3), 1.0), 0.07, 5 + k, NAMES[5 + k]) for k in range(7)]
    meshes = [square((0, 0, -1), (1.8, 0, 0), (0, 1.2, 0), 0), square((0.3, -0.1, 1.2), (0.7, 0.2, 0), (0, 0.5, 0), 1)]
    return SceneDescription(
        meshes=meshes,
        instances=[Instance(0, name="wall"), Instance(1, name="veil")],
        spheres=spheres,
        materials=[material(0), material(1, **veil), *(material(k) for k in range(2, 12))],
        environment=Environment(gray(0.0 if shining is not None else 0.5)),
    )


def decoded(path: Path, layer: str) -> tuple[dict[str, int], list[tuple[np.ndarray, np.ndarray]]]:
    """Reads a Cryptomatte file: returns (manifest: name -> id, pairs of (ids as uint32, coverage), each (h, w))."""
    source = oiio.ImageInput.open(str(path))
    spec, pixels = source.spec(), source.read_image(format="float")
    attributes = {each.name: each.value for each in spec.extra_attribs}
    keys = [key.removesuffix("/name") for key, value in attributes.items() if key.endswith("/name") and value == layer]
    assert len(keys) == 1
    prefix, key = keys[0].split("/")
    assert prefix == "cryptomatte" and len(key) == 7 and int(key, 16) >= 0
    assert attributes[f"{keys[0]}/hash"] == "MurmurHash3_32"
    assert attributes[f"{keys[0]}/conversion"] == "uint32_to_float32"
    manifest = {name: int(id, 16) for name, id in json.loads(attributes[f"{keys[0]}/manifest"]).items()}
    names = list(spec.channelnames)
    assert spec.format == oiio.FLOAT, "ids must not be halves"
    pairs, number = [], 0
    while f"{layer}{number:02}.R" in names:
        r, g, b, a = (pixels[..., names.index(f"{layer}{number:02}.{c}")] for c in "RGBA")
        for id, coverage in ((r, g), (b, a)):
            pairs.append((np.ascontiguousarray(id).view(np.uint32), coverage))
        number += 1
    return manifest, pairs


def matte(pairs: list[tuple[np.ndarray, np.ndarray]], id: int) -> np.ndarray:
    return sum((np.where(ids == id, coverage, 0) for ids, coverage in pairs), np.float32(0))


@pytest.mark.parametrize("kind", ["object", "material"])
def test_mattes_equal_the_coverage_by_brute_force(kind: str, tmp_path: Path) -> None:
    """Each matte equals the picture in which this object alone is white, sample by sample, also through a veil."""
    description = described()
    scene = compile_scene(description)
    summary, stats = summarise(description, scene), RenderStats()
    assert summary["objects"] == NAMES
    asked = replace(SETTINGS, cryptomatte=16)
    sums = render_frame(scene, asked, SPP, stats=stats)
    names = {"objects": summary["objects"], "materials": summary["materials"]}
    planes = layers(stats.hits, sums[SAMPLES], 16, names)
    channels = {name: planes[..., k] for k, name in enumerate(channel_names(16))}
    encode.write(tmp_path / "m.exr", film_math.mean(sums, 24), channels=channels, header=header(names))
    layer, of_kind = {"object": ("CryptoObject", NAMES), "material": ("CryptoMaterial", summary["materials"])}[kind]
    manifest, pairs = decoded(tmp_path / "m.exr", layer)
    assert list(manifest) == of_kind
    assert len(pairs) == 16
    total = np.zeros(sums.shape[1:], np.float32)
    for number, name in enumerate(of_kind):
        lit = render_frame(compile_scene(described(number)), replace(SETTINGS, cryptomatte=0), SPP)
        assert (lit[COLOR][0] % (1 << 24) == 0).all()
        expected = (lit[COLOR][0] >> 24) / SPP
        np.testing.assert_array_equal(matte(pairs, manifest[name]), expected.astype(np.float32), err_msg=name)
        total += matte(pairs, manifest[name])
        assert expected.any(), name
    assert total.max() <= 1
    assert max(len(set(p)) for p in np.stack([ids for ids, _ in pairs]).reshape(16, -1).T) > 4, "no pixel has many objects"
    assert (np.diff(np.stack([coverage for _, coverage in pairs]), axis=0) <= 0).all(), "ranks are in order of coverage"


def test_ids_with_most_samples_are_kept() -> None:
    """Whatever the order in which the parts of the film were added."""
    scene, stats = compile_scene(described()), RenderStats()
    sums = render_frame(scene, SETTINGS, SPP, stats=stats)
    names = {"objects": NAMES}
    all_of, few = (layers(stats.hits, sums[SAMPLES], ranks, names).reshape(20, 30, 3, -1, 2) for ranks in (16, 3))
    np.testing.assert_array_equal(few[..., :3, :].view(np.uint32), all_of[..., :3, :].view(np.uint32))
    assert not few[..., 3, :].any()  # three ranks take two layers of two


def test_an_asset_is_the_sum_of_its_parts_and_copies(tmp_path: Path) -> None:
    """The objects of each pixel, in two samples each: a part and a copy of a cup, a cup and a saucer, nothing and a saucer."""
    names = {"objects": ["cup/handle", "cup [1]", "cup", "saucer", "cups"], "materials": ["china"]}
    ids = np.zeros((3, 2, 2), np.uint32)
    ids[..., 0] = [[1, 2], [3, 4], [0, 4]]
    planes = layers(count_samples(ids), np.full((1, 3), 2), 3, names)
    channels = {name: planes[..., k] for k, name in enumerate(channel_names(3))}
    encode.write(tmp_path / "m.exr", np.zeros((1, 3, 3), np.float32), channels=channels, header=header(names))
    manifest, pairs = decoded(tmp_path / "m.exr", "CryptoAsset")
    assert list(manifest) == ["cup", "saucer", "cups"]
    assert matte(pairs, manifest["cup"]).tolist() == [[1, 0.5, 0]]
    assert matte(pairs, manifest["saucer"]).tolist() == [[0, 0.5, 0.5]]
    assert not matte(pairs, manifest["cups"]).any()
    objects, pairs = decoded(tmp_path / "m.exr", "CryptoObject")
    assert matte(pairs, objects["cup"]).tolist() == [[0, 0.5, 0]]


@pytest.mark.parametrize("size", [7, 16, 64])
def test_counts_do_not_depend_on_batches(size: int) -> None:
    scene, stats = compile_scene(described()), RenderStats()
    whole = render_frame(scene, SETTINGS, 6, stats=stats, threads=1)
    assert stats.hits is not None
    work = [(tile, first, count) for tile in tiles_of(30, 20, size) for first, count in ((0, 1), (1, 2), (3, 3))]
    parts = []
    for k in np.random.default_rng(size).permutation(len(work)):
        tile, first, count = work[k]
        batch = render_batch(scene, SETTINGS, tile, first, count)
        parts.append(moved(batch.hits, tile.x, tile.y, tile.w, 30))
    found = merged(parts)
    np.testing.assert_array_equal(found.key, stats.hits.key)
    np.testing.assert_array_equal(found.count, stats.hits.count)
    plain = render_frame(scene, replace(SETTINGS, cryptomatte=0), 6)
    np.testing.assert_array_equal(plain, whole)
    assert film_math.digest(whole, stats.hits) != film_math.digest(whole)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 1 << 30), st.integers(1, 12), st.integers(0, 9))
def test_counts_round_trip(seed: int, pixels: int, samples: int) -> None:
    random = np.random.default_rng(seed)
    ids = random.choice(np.array([0, 1, 2, 7, 1 << 20, NOT_FINITE], np.uint32), (pixels, samples, 2))
    hits = count_samples(ids)
    expected: dict[tuple[int, int, int], int] = {}
    for pixel, sample, kind in np.ndindex(ids.shape):
        if (id := int(ids[pixel, sample, kind])) not in (0, NOT_FINITE):
            expected[pixel, kind, id] = expected.get((pixel, kind, id), 0) + 1
    found = {(int(k) >> 32, int(k) >> 31 & 1, int(k) & 0x7FFFFFFF): int(c) for k, c in zip(hits.key, hits.count, strict=True)}
    assert found == expected
    halves = [count_samples(part) for part in np.array_split(ids, 2, axis=1)]
    for parts in (halves, halves[::-1]):
        again = merged(parts)
        np.testing.assert_array_equal(again.key, hits.key)
        np.testing.assert_array_equal(again.count, hits.count)
    tile = Tile(0, 0, pixels, 1)
    sums = random.integers(-9, 9, (film_math.CHANNELS, 1, pixels))
    sums[SAMPLES] = samples
    data = pack_sums(sums, hits=hits)
    check_sums(data, tile)
    np.testing.assert_array_equal(unpack_sums(data, tile), sums)
    for back in (unpack_hits(data, tile), merge_hits([pack_sums(sums, PACKED, half) for half in halves], tile)):
        assert back is not None
        np.testing.assert_array_equal(back.key, hits.key)
        np.testing.assert_array_equal(back.count, hits.count)
    assert unpack_hits(pack_sums(sums), tile) is None


def test_damaged_counts_are_rejected() -> None:
    tile, sums = Tile(0, 0, 2, 2), np.zeros((film_math.CHANNELS, 2, 2), np.int64)
    sums[SAMPLES] = 3
    key = np.array([1, 2, 1 << 32 | 1], np.uint64)
    good = Hits(key, np.array([2, 1, 3]))
    data = pack_sums(sums, hits=good)
    check_weight(data, tile, 3)
    with pytest.raises(ValueError, match="4 samples"):
        check_weight(pack_sums(sums, hits=Hits(key, np.array([2, 2, 3]))), tile, 3)
    wrong = [Hits(key[::-1].copy(), good.count), Hits(key + np.uint64(3 << 32), good.count), Hits(key, np.array([2, 0, 3]))]
    for hits in (*wrong, Hits(np.zeros(1, np.uint64), np.array([1]))):
        with pytest.raises(ValueError, match="not in order"):
            check_sums(pack_sums(sums, hits=hits), tile)
    for end in range(len(data)):
        with pytest.raises(ValueError, match="sums"):
            check_sums(data[:end], tile)
    with pytest.raises(ValueError, match="follows"):
        check_sums(data + b"\0", tile)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", 0),
        ("a", 0x3C2569B2),
        ("hello", 0x248BFA47),
        ("hello, world", 0x149BBB7F),
        ("The quick brown fox jumps over the lazy dog", 0x2E4FF723),
    ],
)
def test_murmur_hash(text: str, expected: int) -> None:
    """Values of the reference implementation (smhasher), published in many places."""
    assert cryptomatte._murmur3(text.encode()) == expected


@given(st.text(max_size=30))
def test_ids_are_normal_floats(name: str) -> None:
    id = hash_of(name)
    (value,) = struct.unpack("<f", struct.pack("<I", id))
    assert np.isfinite(value)
    assert abs(value) >= np.finfo(np.float32).tiny


def test_objects_with_one_name_share_a_matte() -> None:
    hits = Hits(np.array([1, 2], np.uint64), np.array([3, 1]))
    found = layers(hits, np.array([[4]]), 2, {"objects": ["leaf", "leaf"]})
    assert found[0, 0, :2].view(np.uint32)[0] == hash_of("leaf")
    assert found[0, 0, 1:4].tolist() == [1.0, 0.0, 0.0]
    unnamed = layers(hits, np.array([[4]]), 2, {})
    assert unnamed[0, 0, :1].view(np.uint32)[0] == hash_of("object 0")
