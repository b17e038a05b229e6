"""The sample files that others wrote: each loads, and is what it is known to be."""

import zipfile

import numpy as np
import pytest

from renderer.formats import pick_main
from renderer.scene.compile import compile_scene, summarise
from renderer.scene.load import read


@pytest.mark.parametrize(
    ("file", "triangles", "textures", "warned"),
    [
        ("CesiumMilkTruck.glb", 3624, 1, ["Animations", "no light"]),
        ("Duck.glb", 4212, 1, ["no light"]),
        ("BoxTextured.glb", 12, 1, ["no light"]),
        ("AlphaBlendModeTest.glb", 61, 3, ["no light"]),
        ("TestScene.gltf", 1096, 0, ["KHR_materials_common", "own lights are weak"]),
        ("duck.dae", 4212, 0, ["duckCM.tga", "no light"]),
        ("bunny.ply", 16301, 0, ["no light"]),
        ("teapot.obj", 6320, 0, ["no light"]),
        ("suzanne.obj", 968, 0, ["no light"]),
    ],
)
def test_sample(assets, file, triangles, textures, warned):
    description = read(assets, file)
    scene = compile_scene(description)
    assert len(scene.triangle) == triangles
    assert len(scene.texture) >= textures
    said = " ".join(description.warnings)
    assert all(w in said for w in warned)
    assert len(description.warnings) >= len(warned)
    np.testing.assert_allclose(np.linalg.norm(scene.normal, axis=1), 1, rtol=1e-5)
    assert summarise(description, scene)["cameras"][-1]["name"] == "auto"


def test_the_alpha_modes_of_the_sample(assets):
    modes = {m.name: (m.alpha_mode, m.alpha_cutoff) for m in read(assets, "AlphaBlendModeTest.glb").materials}
    assert modes == {
        "MatBed": ("opaque", 0.5),
        "MatBlend": ("blend", 0.5),
        "MatCutoff25": ("mask", 0.25),
        "MatCutoff75": ("mask", 0.75),
        "MatCutoffDefault": ("mask", 0.5),
        "MatOpaque": ("opaque", 0.5),
    }


def test_a_texture_whose_name_holds_a_space(assets):
    description = read(assets / "fuze", "fuze.obj")
    assert description.images[0].name == "fuze uv.jpg"


def test_a_zip_as_a_mac_makes_it(assets, tmp_path):
    with zipfile.ZipFile(assets / "spot.zip") as archive:
        archive.extractall(tmp_path)
        main, _ = pick_main(archive.namelist())
    description = read(tmp_path, main)
    assert main == "spot/spot_triangulated.obj"
    assert description.images[0].name == "spot/spot_texture.png"


def test_an_hdr_environment(assets, tmp_path):
    for name in ("suzanne.obj", "museum.exr"):
        (tmp_path / name).write_bytes((assets / name).read_bytes())
    description = read(tmp_path, "suzanne.obj", environment="museum.exr")
    scene = compile_scene(description)
    assert scene.environment.shape == (256, 512, 3)
    assert scene.environment_frame[3] == 1
    assert not any("no light" in w for w in description.warnings)


def test_the_duck_is_the_same_from_both_its_formats(assets):
    gltf, dae = (compile_scene(read(assets, name)) for name in ("Duck.glb", "duck.dae"))
    np.testing.assert_allclose(gltf.bounds, dae.bounds / 100, rtol=1e-4)  # one in metres, one in centimetres
