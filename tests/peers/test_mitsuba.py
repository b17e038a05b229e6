"""Side by side with Mitsuba 3: the same small scenes, rendered by both from one description."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.film import mean
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from tests.grids import grid
from tests.peers.compare import assert_same_picture
from tests.peers.mitsuba_scene import mitsuba_dict
from tests.peers.scenes import SCENES

BATCHES = 16
SPP = 16


@pytest.fixture(scope="module")
def mi():
    """Mitsuba; its scalar variant needs no LLVM."""
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    return mitsuba


@grid("name", SCENES, ordinary=("cornell_box", "mirror_and_glass", "textured_light", "instances"))
def test_the_same_picture(name, mi, tmp_path):
    description, settings = SCENES[name]()
    their_scene = mi.load_dict(mitsuba_dict(mi, description, settings, tmp_path))
    theirs = [np.array(mi.render(their_scene, spp=SPP, seed=1 + i)) for i in range(BATCHES)]
    our_scene = compile_scene(description)
    ours = [mean(render_frame(our_scene, replace(settings, seed=1 + i), SPP), settings.film_exponent) for i in range(BATCHES)]
    print(assert_same_picture(np.stack(ours).astype(float), np.stack(theirs).astype(float)))
