"""Tests that pin the digests of small pictures: a change of their bits has to be intended, and stated in the changelog."""

from __future__ import annotations

import pytest

from renderer.cpu import TARGET
from renderer.film import digest
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.load import read
from renderer.settings import RenderSettings
from tests.benchmarks.peers.scenes import CASES
from tests.benchmarks.peers.sizes import QUICK
from tests.helpers import ROOT

pytestmark = pytest.mark.skipif(not TARGET.startswith("x86-64"), reason="The digests are those of x86-64 processors.")

SPP = 4
OF_CASES = {
    "Cornell box": "68ef73276c23",
    "large mesh, diffuse": "68dd7904adb0",
    "large mesh, rough plastic": "1548ae776863",
    "glass and rough metal": "0ffdb9365ab1",
    "textured mesh": "6dfb103f7f60",
    "many lights": "f23d751a4871",
}
OF_EXAMPLES = {"cornell-box": "60ac1a92bd35", "spheres": "7d91653144c6", "still-life": "f042e7bc5dbc"}


@pytest.mark.parametrize("name", CASES)
def test_peers_scene_has_the_same_digest_as_before(name: str) -> None:
    """The scenes whose films an earlier prototype compared with those of a graphics card (docs/graphics-cards.md)."""
    case = CASES[name](QUICK)
    assert digest(render_frame(compile_scene(case.description), case.settings(32), SPP))[:12] == OF_CASES[name]


@pytest.mark.parametrize("name", OF_EXAMPLES)
def test_example_has_the_same_digest_as_before(name: str) -> None:
    description = read(ROOT / "scenes", f"{name}.yaml")
    settings = RenderSettings(48, 32, description.cameras[0].view)
    assert digest(render_frame(compile_scene(description), settings, SPP))[:12] == OF_EXAMPLES[name]
