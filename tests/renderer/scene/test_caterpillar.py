"""Tests of the shot scenes/caterpillar: its files match the script that generates them, and it moves as intended."""

import io
import json
import re
import runpy
import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from renderer.frames import parse_frames
from renderer.scene.animation import Moment
from renderer.scene.load import Shot
from tests.renderer.scene.test_shutter_merge import moving

SCENES = Path(__file__).parents[3] / "scenes"
FOLDER = SCENES / "caterpillar"
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
TYPES = {5121: "u1", 5123: "<u2", 5126: "<f4"}


def content(file):
    """Returns a GLB's content for comparison: its document without offsets and bounds, its arrays, its decoded images.

    Other library versions compress images differently, and last digits of powers and sines depend on the host.
    """
    (length,) = struct.unpack_from("<I", file, 12)
    document, binary = json.loads(file[20 : 20 + length]), file[28 + length :]
    views, accessors = document.pop("bufferViews"), document.pop("accessors")
    del document["buffers"]
    parts = [binary[v["byteOffset"] : v["byteOffset"] + v["byteLength"]] for v in views]
    arrays = [np.frombuffer(parts[a["bufferView"]], TYPES[a["componentType"]]).reshape(-1, WIDTHS[a["type"]]) for a in accessors]
    pictures = [np.asarray(Image.open(io.BytesIO(parts[i["bufferView"]]))) for i in document.get("images", [])]
    return document, arrays, pictures


@pytest.fixture(scope="module")
def made():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(SCENES))
        return runpy.run_path(str(SCENES / "caterpillar.py"))


@pytest.mark.long
def test_files_match_their_generator(made):
    files = made["files"]()
    assert {path.name for path in FOLDER.iterdir()} == set(files)
    for name, new in files.items():
        kept = (FOLDER / name).read_bytes()
        assert len(kept) < 2**20
        if name.endswith(".glb"):
            (document, arrays, pictures), (wanted, *others) = content(kept), content(new)
            assert document == wanted, name
            for a, b in zip([*arrays, *pictures], [*others[0], *others[1]], strict=True):
                tolerance = 1.0 if a.dtype == np.uint8 else 1e-5
                np.testing.assert_allclose(a.astype(float), b.astype(float), atol=tolerance, err_msg=name)
        elif name.endswith(".jpg"):
            pair = [np.asarray(Image.open(io.BytesIO(data))).astype(int) for data in (kept, new)]
            assert np.abs(pair[0] - pair[1]).mean() < 1, name
        else:
            assert kept.decode() == new, name


def test_animation_loops(made):
    """The frame after the last equals the first, so that the animation can loop."""
    period = made["FRAMES"] / made["FPS"]
    ends = np.array([0.0, period])
    for values in (*made["bones"](ends), *made["camera"](ends), made["top_place"](ends)):
        np.testing.assert_allclose(values[0], values[1], atol=1e-9)
    for degrees in made["top_turns"](ends).values():
        turns = (degrees[1] - degrees[0]) / 360
        assert turns == pytest.approx(round(turns), abs=1e-9)


def test_skin_deforms_and_camera_follows():
    shot = Shot(FOLDER, "caterpillar.yaml")
    first, later = (shot.scene_at(Moment(frame)) for frame in (0.0, 30.0))
    assert first.warnings == []
    assert first.defaults["shutter"] == 0.5
    (clip,) = first.clips
    asked = re.search(r"^# Frames (\S+)", (FOLDER / "caterpillar.yaml").read_text(), re.MULTILINE)
    frames = parse_frames(asked.group(1))
    assert (clip.start, clip.end * first.fps) == (frames[0], pytest.approx(frames[-1], abs=1e-3)), "what is offered is all of it"

    assert moving(first) == ({"top/leans/spins/mesh 0"}, {"caterpillar/caterpillar"})
    assert np.linalg.norm(np.subtract(first.cameras[0].view.eye, later.cameras[0].view.eye)) > 0.5

    def distances(description):
        """Returns the distances between all pairs of every hundredth vertex of the caterpillar's skin."""
        skin = max((mesh.positions for mesh in description.meshes if mesh.deforms), key=len)
        return np.linalg.norm(skin[::100, None] - skin[None, ::100], axis=-1)

    assert np.abs(distances(first) - distances(later)).max() > 0.2, "it does not move as one piece"
