"""Tests that bytes on the wire equal those of earlier releases in recorded.json, which is never regenerated."""

from __future__ import annotations

import json
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from protocol.pictures import (
    DRAFT,
    VIEW,
    VIEW_TILE,
    DraftHead,
    FilmHead,
    TileHead,
    ViewTile,
    decode_film,
    decode_tile,
    decode_view,
    encode_draft,
    encode_film,
    encode_tile,
    encode_view,
    planes_of,
)
from protocol.result_bytes import result_of
from protocol.view_parts import ViewAnswer
from renderer.image import rgbe9995
from tests.protocol.messages import LIGHT, encoded_messages

RECORDED: dict[str, Any] = json.loads(Path(__file__).with_name("recorded.json").read_text())
PICTURES = ("tile", "film", "view")
ENCODED = encoded_messages()
WORDS = rgbe9995.pack(LIGHT)
PLANES = np.moveaxis(LIGHT, -1, 0)
VIEW_TILES = [ViewTile((0, 0, 3, 3), PLANES[..., :3], 4, False), ViewTile((3, 0, 2, 3), PLANES[..., 3:], 64, True)]
VIEW_HEADS = VIEW.size + 2 * VIEW_TILE.size


@pytest.mark.parametrize("name", [name for name in RECORDED if name not in PICTURES])
def test_message_encoding_equals_recording(name: str) -> None:
    assert json.loads(json.dumps(ENCODED[name])) == RECORDED[name]


def test_tile_encoding_equals_recording() -> None:
    packet = encode_tile(75, 2**32 + 7, (5, 6, 2, 1), 64, WORDS[:1, :2].astype("<u4").tobytes())
    assert packet.hex() == RECORDED["tile"]
    head, words = decode_tile(packet)
    assert head == TileHead(75, 7, 5, 6, 2, 1, 64)
    np.testing.assert_array_equal(words, WORDS[:1, :2])


def test_film_encoding_equals_recording() -> None:
    packet = b"".join(encode_film(0, (5, 3), 5, [1], planes_of(WORDS)))
    assert packet.hex() == RECORDED["film"]
    head, samples, words = decode_film(packet)
    assert head == FilmHead(0, 5, 3, 5) and samples.tolist() == [1]
    np.testing.assert_array_equal(words, WORDS)


def test_view_encoding_equals_recording() -> None:
    """A view is encoded and decoded as recorded; bodies are compared decompressed, since zlib releases compress differently."""
    packet = encode_view(VIEW_TILES, (5, 3), (50, 30), 9, 3)
    assert packet[:VIEW_HEADS].hex() == RECORDED["view"]["head"]
    assert zlib.decompress(packet[VIEW_HEADS:], -15).hex() == RECORDED["view"]["body"]
    head, tiles = decode_view(packet)
    assert head == (2, 9, 3, 5, 3, 50, 30)
    assert [tile[::2] for tile in tiles] == [tile[::2] for tile in VIEW_TILES]
    np.testing.assert_allclose(tiles[0].mean.sum(0), VIEW_TILES[0].mean.sum(0), rtol=0.02)
    np.testing.assert_array_equal(rgbe9995.pack(np.moveaxis(tiles[1].mean, 0, -1)), WORDS[:, 3:])


def test_draft_encoding_is_as_documented() -> None:
    packet = encode_draft(DraftHead(2**32 + 9, 3, 5, 3, 50, 30, 4, -1.5), b"JPEG")
    assert packet == bytes.fromhex("0106 09000000 03000000 0500 0300 3200 1e00 04000000 0000c0bf") + b"JPEG"
    assert DRAFT.unpack(packet) == (9, 3, 5, 3, 50, 30, 4, -1.5)


@pytest.mark.parametrize("decode", [decode_tile, decode_film, decode_view])
@pytest.mark.parametrize("name", PICTURES)
def test_damaged_packet_is_rejected(decode: Any, name: str) -> None:
    recorded = RECORDED[name]
    packet = bytes.fromhex(recorded if isinstance(recorded, str) else recorded["head"] + recorded["body"])
    for damaged in (packet[:1], packet[:-1], packet + b"\0", bytes([9]) + packet[1:]):
        with pytest.raises(ValueError, match=r"a (tile|film|view|packet)"):
            decode(damaged)


def test_recorded_answers_are_decoded() -> None:
    answer = ViewAnswer.from_bytes(bytes.fromhex(RECORDED["view_answer"]))
    assert (answer.type, answer.more["number"], answer.sums) == ("part", 1, b"SUMS")
    result = result_of(bytes.fromhex(RECORDED["result_bytes"]))
    assert (result.event["batch"], result.sums) == ("b1", b"SUMS")
