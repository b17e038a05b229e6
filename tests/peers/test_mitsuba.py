"""Tests against Mitsuba 3: Rayfarm and Mitsuba render the same small scenes from one description."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderer.film import mean
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from tests.grids import grid
from tests.peers.compare import assert_same_picture
from tests.peers.media import MEDIA
from tests.peers.mitsuba_scene import mitsuba_dict
from tests.peers.scenes import SCENES

BATCHES = 16
SPP = 16


@pytest.fixture(scope="module")
def mi():
    """Returns the mitsuba module with its scalar variant selected, which needs no LLVM."""
    mitsuba = pytest.importorskip("mitsuba")
    mitsuba.set_variant("scalar_rgb")
    return mitsuba


@grid("name", SCENES, ordinary=("mirror_and_glass",))
def test_the_same_picture(name, mi, tmp_path):
    judge(mi, SCENES[name](), SPP, tmp_path)


@pytest.mark.long  # closed forms in tests/renderer/test_media.py are part of the default run
@pytest.mark.parametrize("name", MEDIA)
def test_the_same_picture_of_what_light_scatters_in(name, mi, tmp_path):
    judge(mi, MEDIA[name](), 96 if name == "haze_with_a_spot" else 32, tmp_path)


def judge(mi, case, spp, folder):
    description, settings = case
    their_scene = mi.load_dict(mitsuba_dict(mi, description, settings, folder))
    theirs = [np.array(mi.render(their_scene, spp=spp, seed=1 + i)) for i in range(BATCHES)]
    our_scene = compile_scene(description)
    ours = [mean(render_frame(our_scene, replace(settings, seed=1 + i), spp), settings.film_exponent) for i in range(BATCHES)]
    print(assert_same_picture(np.stack(ours).astype(float), np.stack(theirs).astype(float)))
