"""Tests of choosing the main scene file among many: the format with the most information first, then the shallowest folder."""

import sys
from importlib import import_module
from types import ModuleType

import pytest

from renderer.errors import SceneError
from renderer.formats import FORMATS, MESH_FORMATS, Format, is_junk, pick_main
from renderer.scene.description import SceneDescription
from renderer.scene.files import SceneFiles
from renderer.scene.readers.by_format import read_file


def test_best_format_then_shallowest_path_is_chosen():
    assert pick_main(["a.obj", "deep/b.glb", "a.mtl", "t.png"])[0] == "deep/b.glb"
    assert pick_main(["deep/a.glb", "b.glb"])[0] == "b.glb"
    assert pick_main(["mesh.ply", "scene.yaml", "model.glb"])[0] == "scene.yaml"
    assert pick_main(["parts/a.usd", "parts/b.usdz", "main.usdc"])[0] == "main.usdc"


def test_unsupported_file_error_suggests_an_export():
    for name, says in (("a.skp", "COLLADA"), ("deep/A.MAX", "glTF"), ("a.7z", "Unpack")):
        with pytest.raises(SceneError, match=f"{name} cannot be read here.*{says}"):
            pick_main(["readme.txt", name])
    assert pick_main(["a.blend", "a.glb"])[0] == "a.glb"


def test_macos_zip_yields_the_model_and_names_alternatives():
    names = ["spot/spot_control_mesh.obj", "spot/spot_quadrangulated.obj", "spot/spot_triangulated.obj"]
    main, warnings = pick_main([*names, "__MACOSX/spot/._spot_triangulated.obj", "spot/spot_texture.png"])
    assert main == "spot/spot_triangulated.obj"
    assert "spot_control_mesh.obj" in warnings[0]
    assert "__MACOSX" not in warnings[0]


def test_alternative_scenes_are_named_without_included_files():
    assert "b.fbx" in pick_main(["a.glb", "b.fbx"])[1][0]
    assert pick_main(["a.yaml", "b.obj", "c.glb"])[1] == []
    assert "b.xml" in pick_main(["a.pbrt", "b.xml", "c.ply"])[1][0]
    assert pick_main(["geometry.pbrt", "materials.pbrt", "kitchen-scene.pbrt", "c.ply"]) == ("kitchen-scene.pbrt", [])


@pytest.mark.parametrize("names", [[], ["readme.txt", "t.png"], [".hidden.glb"], ["__MACOSX/a.glb"]])
def test_missing_scene_error_lists_the_formats(names):
    with pytest.raises(SceneError, match=r"GLB|glb"):
        pick_main(names)


def test_junk():
    assert is_junk("__MACOSX/x.obj")
    assert is_junk("a/.DS_Store")
    assert not is_junk("a/b.obj")


@pytest.mark.parametrize("format", FORMATS, ids=lambda f: f.suffix)
def test_every_format_has_its_reader(format):
    assert callable(import_module(f"renderer.scene.readers.{format.reader}").read)


def test_format_needs_only_a_reader_and_a_table_row(tmp_path, monkeypatch):
    reader = ModuleType("lines")
    reader.read = lambda files, name, description: description.warnings.append(files.read(name).decode())
    monkeypatch.setitem(sys.modules, "renderer.scene.readers.lines", reader)
    (tmp_path / "a.LINES").write_text("read")
    description = SceneDescription()
    read_file(SceneFiles(tmp_path), "a.LINES", description, formats=(*FORMATS, Format(".lines", "lines")))
    assert description.warnings == ["read"]
    with pytest.raises(SceneError, match=r"a\.LINES is not a supported scene file; give one of \.glb"):
        read_file(SceneFiles(tmp_path), "a.LINES", description, formats=MESH_FORMATS)


def test_nested_archive_error_names_a_remedy() -> None:
    with pytest.raises(SceneError, match=r"inner\.zip cannot be read here\. Unpack it, and give the folder or a \.zip of it\."):
        pick_main(["inner.zip", "readme.txt"])
    assert pick_main(["inner.zip", "room.obj"])[0] == "room.obj"
