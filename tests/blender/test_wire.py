"""Tests that the add-on decodes what the farm's own code encodes."""

from __future__ import annotations

import io

import numpy as np
import pytest

from blender.rayfarm_addon.farm import exr, packets
from blender.rayfarm_addon.farm.multipart import Part, body_of
from blender.rayfarm_addon.farm.protocol import rgbe9995 as addon_rgbe9995
from protocol.pictures import ViewTile, encode_view
from renderer.image import rgbe9995
from renderer.image.encode import encode
from renderer.image.read import read as read_image
from renderer.settings import Tile

LIGHT = np.random.default_rng(7).gamma(1.0, 2.0, (37, 53, 3)).astype(np.float32)


@pytest.mark.parametrize("height", [1, 16, 37])
def test_exr_from_the_farm_is_read_exactly(height: int) -> None:
    light = LIGHT[:height]
    depth = light[..., 0] * 100
    found = exr.read(encode(light, "exr", channels={"Depth.Z": depth}))
    assert set(found) == {"R", "G", "B", "Depth.Z"}
    np.testing.assert_array_equal(np.stack([found[c] for c in "RGB"], -1), light)
    np.testing.assert_array_equal(found["Depth.Z"], depth)


def test_exr_written_by_the_add_on_is_readable() -> None:
    np.testing.assert_array_equal(read_image(exr.write(LIGHT), "world.exr"), LIGHT)


@pytest.mark.parametrize("damage", [b"", b"not a picture", None])
def test_damaged_exr_raises_value_error(damage: bytes | None) -> None:
    data = encode(LIGHT, "exr")[:-200] if damage is None else damage
    with pytest.raises(ValueError):
        exr.read(data)


def test_rgb9e5_words_are_decoded() -> None:
    words = rgbe9995.pack(LIGHT)
    np.testing.assert_array_equal(addon_rgbe9995.unpack(words), rgbe9995.unpack(words))
    shown = packets.rgba(addon_rgbe9995.unpack(words))
    assert shown.shape == (37, 53, 4)
    np.testing.assert_array_equal(shown[0, :, :3], rgbe9995.unpack(words)[-1])


def test_view_is_updated_tile_by_tile() -> None:
    planes = np.moveaxis(LIGHT, -1, 0)
    left, right = Tile(0, 0, 21, 37), Tile(21, 0, 32, 37)
    tiles = [ViewTile(left, planes[:, :, :21], 4, False), ViewTile(right, planes[:, :, 21:], 64, True)]
    view = packets.ProgressiveView()
    view.add_packet(encode_view(tiles, (53, 37), (53, 37), 9, 3))
    assert (view.id, view.seq, view.whole) == (9, 3, (53, 37))
    np.testing.assert_array_equal(view.rgb[:, 21:], rgbe9995.unpack(rgbe9995.pack(LIGHT[:, 21:])))
    coarse, truth = view.rgb[:, :21].sum(-1), LIGHT[:, :21].sum(-1)
    np.testing.assert_allclose(coarse, truth, rtol=0.03)
    view.add_packet(encode_view([ViewTile(left, planes[:, :, :21], 64, True)], (53, 37), (53, 37), 9, 4))
    np.testing.assert_array_equal(view.rgb, rgbe9995.unpack(rgbe9995.pack(LIGHT)))
    view.add_packet(encode_view([ViewTile(Tile(0, 0, 7, 5), planes[:, :5, :7], 64, True)], (7, 5), (53, 37), 10, 5))
    assert view.rgb.shape == (5, 7, 3)


def test_form_length_matches_content_length(tmp_path) -> None:
    (tmp_path / "b").write_bytes(b"y" * 700_000)
    parts = [Part("files", 'a "b".bin', b"x" * 10), Part("files", "b.bin", tmp_path / "b"), Part("files", "c", b"")]
    kind, size, pieces = body_of(parts, {"main": "a", "name": "Fräulein"})
    sent = io.BytesIO(b"".join(pieces)).getvalue()
    assert len(sent) == size
    assert sent.count(kind.partition("=")[2].encode()) == 6
    assert b'filename="a %22b%22.bin"' in sent
