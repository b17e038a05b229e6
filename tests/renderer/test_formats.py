"""Which of many files is the scene."""

import pytest

from renderer.errors import SceneError
from renderer.formats import is_junk, pick_main


def test_the_kind_that_says_most_wins_then_the_shallowest():
    assert pick_main(["a.obj", "deep/b.glb", "a.mtl", "t.png"])[0] == "deep/b.glb"
    assert pick_main(["deep/a.glb", "b.glb"])[0] == "b.glb"
    assert pick_main(["mesh.ply", "scene.yaml", "model.glb"])[0] == "scene.yaml"


def test_a_mac_zip_gives_the_model_and_names_its_rivals():
    names = ["spot/spot_control_mesh.obj", "spot/spot_quadrangulated.obj", "spot/spot_triangulated.obj"]
    main, warnings = pick_main([*names, "__MACOSX/spot/._spot_triangulated.obj", "spot/spot_texture.png"])
    assert main == "spot/spot_triangulated.obj"
    assert "spot_control_mesh.obj" in warnings[0]
    assert "__MACOSX" not in warnings[0]


@pytest.mark.parametrize("names", [[], ["readme.txt", "t.png"], [".hidden.glb"], ["__MACOSX/a.glb"]])
def test_no_scene_is_an_error_that_names_what_is_one(names):
    with pytest.raises(SceneError, match=r"\.glb"):
        pick_main(names)


def test_junk():
    assert is_junk("__MACOSX/x.obj")
    assert is_junk("a/.DS_Store")
    assert not is_junk("a/b.obj")
