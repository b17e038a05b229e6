"""Tests that joint batches are decoded as they were encoded, and that invalid ones are refused."""

from __future__ import annotations

import json

import pytest

from protocol.contract import RenderBatch
from protocol.joint import JointBatch, Piece
from renderer.settings import RenderSettings, Tile, View


def test_joint_batch_round_trip_and_pieces() -> None:
    settings = RenderSettings(64, 64, View((0, 0, 4), (0, 0, 0)))
    whole = RenderBatch("m", "job", 2, "a" * 64, Tile(0, 0, 64, 64), 8, 5, settings, 2)
    joint = JointBatch(whole, (Piece("x", 8, 2), Piece("y", 10, 3)), 1.5)
    there = JointBatch.from_json(json.loads(json.dumps(joint.to_json())) | {"news": 1})
    assert there == joint
    assert there.batch(1) == RenderBatch("y", "job", 2, "a" * 64, Tile(0, 0, 64, 64), 10, 3, settings, 2)


@pytest.mark.parametrize("words", [None, [], {"pieces": []}, {"pieces": [["a", 1]]}, {"pieces": [], "whole": {}, "hold_s": 1}])
def test_invalid_joint_batch_is_rejected(words: object) -> None:
    with pytest.raises((ValueError, TypeError, KeyError)):
        JointBatch.from_json(words)
