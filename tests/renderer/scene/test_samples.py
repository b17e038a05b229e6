"""Tests of sample files from another program: each loads with its known contents."""

import re
import zipfile

import numpy as np
import pytest

from renderer.formats import pick_main
from renderer.scene.compile import compile_scene, summarise
from renderer.scene.load import read
from tests.renderer.scene.builders import Gltf


@pytest.mark.parametrize(
    ("file", "triangles", "textures"),
    [
        ("toy.glb", 1472, 1),
        ("modes.glb", 36, 0),
        ("parts/model.gltf", 1472, 1),
        ("body.dae", 1280, 0),
        ("body.ply", 1280, 0),
        ("ascii.ply", 1280, 0),
        ("body.stl", 1280, 0),
        ("body.obj", 1280, 0),
        ("painted/painted.obj", 1280, 1),
    ],
)
def test_sample(samples, file, triangles, textures):
    folder, name = (samples / file).parent, (samples / file).name
    description = read(folder, name)
    scene = compile_scene(description)
    assert len(scene.triangle) == triangles
    assert len(scene.texture) == textures
    assert [w for w in description.warnings if "no light" not in w] == []
    np.testing.assert_allclose(np.linalg.norm(scene.normal, axis=1), 1, rtol=1e-5)
    assert summarise(description, scene)["cameras"][-1]["name"] == "auto"


def test_body_is_equal_in_all_formats(samples):
    names = ("body.ply", "ascii.ply", "body.stl", "body.dae", "body.obj", "painted/painted.obj")
    bounds = [compile_scene(read((samples / name).parent, (samples / name).name)).bounds for name in names]
    np.testing.assert_allclose(bounds, bounds[:1] * len(bounds), rtol=1e-4)


def test_nodes_and_the_camera_of_the_toy(samples):
    description = read(samples, "toy.glb")
    wheels = [i for i in description.instances if i.transform[1, 3] != 0]
    assert sorted(round(float(i.transform[0, 3]), 3) for i in wheels) == [-1.2, 1.2]
    assert len({i.mesh for i in wheels}) == 1, "one mesh on two nodes"
    assert len(description.meshes) == 2
    view = description.cameras[0].view
    np.testing.assert_allclose((view.eye, view.up), ((0, 0, 6), (0, 1, 0)), atol=1e-5)
    assert view.fov == pytest.approx(45, abs=0.1)


def test_the_alpha_modes_of_the_sample(samples):
    found = {m.name: (m.alpha_mode, m.alpha_cutoff) for m in read(samples, "modes.glb").materials}
    assert found == {"bed": ("opaque", 0.5), "pane": ("blend", 0.5), "leaf": ("mask", 0.25)}


def test_texture_name_with_a_space(samples):
    description = read(samples / "painted", "painted.obj")
    assert description.images[0].name == "body uv.png"


def test_zip_made_by_macos(samples, tmp_path):
    with zipfile.ZipFile(samples / "mac.zip") as archive:
        archive.extractall(tmp_path)
        main, _ = pick_main(archive.namelist())
    description = read(tmp_path, main)
    assert main == "cow/cow_triangulated.obj"
    assert description.images[0].name == "cow/cow_texture.png"


def test_an_hdr_environment(samples):
    description = read(samples, "body.obj", environment="sky.exr")
    scene = compile_scene(description)
    assert scene.environment.shape == (256, 512, 3)
    assert scene.environment.max() == pytest.approx(500)
    assert scene.environment_frame[3] == 1
    assert not any("no light" in w for w in description.warnings)


def test_weak_emission_gets_studio_lighting(scene):
    g = Gltf()
    g.mesh(material=g.material(emissiveFactor=[1e-3, 1e-3, 1e-3]))
    description = scene("ember.glb", g.glb())
    compile_scene(description)
    assert any("own lights are weak" in w for w in description.warnings)


def test_missing_collada_texture(samples, scene):
    text = (samples / "body.dae").read_text()
    image = '<library_images><image id="skin"><init_from>skinCM.tga</init_from></image></library_images>'
    surface = (
        '<newparam sid="s"><surface type="2D"><init_from>skin</init_from></surface></newparam>'
        '<newparam sid="m"><sampler2D><source>s</source></sampler2D></newparam>'
    )
    text = text.replace("<library_effects>", image + "<library_effects>", 1)
    text = text.replace("<profile_COMMON>", "<profile_COMMON>" + surface, 1)
    text = re.sub(
        r"<diffuse>.*?</diffuse>", '<diffuse><texture texture="m" texcoord="UV0"/></diffuse>', text, count=1, flags=re.S
    )
    description = scene("body.dae", text)
    assert len(compile_scene(description).triangle) == 1280
    assert any("skinCM.tga" in w for w in description.warnings), description.warnings
