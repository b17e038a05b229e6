"""Tests that a farm's motion vectors equal those of `rayfarm render`, for every camera that a request can name."""

from __future__ import annotations

import os
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from protocol.contract import FrameVectors, Manifest
from rayfarm.frame import PictureOrder, motion_of
from rayfarm.picture import Picture
from rayfarm.rendering import Clock
from rayfarm.stage import OpenScene
from renderer.frames import frame_key
from renderer.scene.animation import Moment
from renderer.scene.compile import compile_scene, summarise
from renderer.scene.load import Shot
from renderer.settings import View
from tests.worker.work.test_frames import animated_scene
from worker.reading import vectors

OWN = View((1.0, 2.0, 6.0), (0.0, 0.0, 0.0))
VIEWS = {
    "its camera": ({}, {}),
    "another clip": ({}, {"clip": "far"}),
    "what frames it": ({"camera": "auto"}, {}),
    "what frames another clip": ({"camera": "auto"}, {"clip": "far"}),
    "one's own": ({"eye": OWN.eye, "target": OWN.target, "fov": OWN.fov}, {}),
    "a turntable": ({}, {"turntable": 2.0, "fps": 12.0}),
}


@pytest.mark.parametrize("name", VIEWS)
def test_motion_vectors_equal_command_output(tmp_path: Path, name: str) -> None:
    (tmp_path / "shot.glb").write_bytes(animated_scene(True, True).glb())
    given, asked = VIEWS[name]
    description = Shot(tmp_path, "shot.glb").scene_at()
    cameras = summarise(description, compile_scene(description))["cameras"]
    auto = cameras[-1]["view"]
    picture = Picture({"size": "48x32", **given})
    moment = Moment(6.5, asked.get("fps"), asked.get("clip"))
    order = PictureOrder(picture, ["motion"], False, 0.0, "neutral", None, 0, asked.get("turntable"), None)
    stage = OpenScene(Shot(tmp_path, "shot.glb"), picture.camera, threads=1)
    expected = motion_of(stage, order, moment, Clock())
    own = {**asdict(OWN), "near": cameras[0]["view"]["near"]}  # options of the command keep values that they do not name
    request: dict[str, Any] = {"camera": given.get("camera"), "view": own if "eye" in given else None}
    work = FrameVectors("work", "job", frame_key(6.5), "scene", 48, 32, auto, **request, **asked)
    result = tmp_path / "vectors.f32"
    link: Any = None
    sent = FrameVectors.from_json(asdict(work))
    vectors.vectors(os.fsencode(tmp_path), Manifest("scene", "shot.glb", []), sent, os.fsencode(result), link)
    found = np.fromfile(result, "<f4").reshape(32, 48, 4)
    assert np.abs(found).max() > 0.1
    np.testing.assert_array_equal(found, expected)
