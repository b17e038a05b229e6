"""Our scene files: what they say is what is read, and what is wrong is said with line and field."""

import json
import runpy
from pathlib import Path

import numpy as np
import pytest

from renderer.errors import SceneError
from renderer.scene.geometry import flatten
from renderer.scene.load import read

QUAD = "shapes:\n  - {type: quad}\n"


def test_the_whole_format(scene, png):
    description = scene(
        "s.yaml",
        """
name: everything
settings: {width: 320, height: 200, spp: 1e2, max_depth: 5, integrator: path}
cameras:
  - {name: a, eye: [0, 1, 5], target: [0, 0, 0], fov: 30}
  - {eye: [0, 0, 5], target: [0, 0, 0], up: [1, 0, 0]}
environment: {color: [1, 2, 3], strength: 0.5, rotation: 90}
textures:
  wood: {image: wood.png, wrap: mirror}
  rough: {image: wood.png, encoding: linear}
  floor: {checker: {colors: [0, "#ffffff"], squares: 4}}
materials:
  table: {texture: wood, metallic_roughness_texture: rough, kind: metallic_roughness, roughness: 0.3}
  pane: {kind: glass, ior: 1.45}
  lamp: {color: 0, emission: 12, double_sided: true}
shapes:
  - {type: cube, material: table, name: box}
  - {type: sphere, material: pane, center: [1, 0, 0], radius: 2, transform: [{scale: 2}, {translate: [0, 5, 0]}]}
  - {type: disk, material: lamp, segments: 64}
  - type: quad
    transform: [{scale: [2, 1, 1]}]
    instances: [[{translate: [5, 0, 0]}], [{rotate: {axis: z, degrees: 90}}, {translate: [0, 7, 0]}]]
  - {type: lathe, profile: [[0, 0], [1, 0], [1, 1]], segments: 12}
  - {type: mesh, file: tri.obj, material: table}
""",
        {"wood.png": png(10, 20, 30), "tri.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"},
    )
    assert description.name == "everything"
    assert description.defaults == {"width": 320, "height": 200, "spp": 100, "max_depth": 5, "integrator": "path"}
    assert [c.name for c in description.cameras] == ["a", "camera 1"]
    assert description.cameras[0].view.fov == 30
    environment = description.environment
    assert (environment.color, environment.strength, environment.rotation) == ((1, 2, 3), 0.5, 90)
    table, pane, lamp = description.materials[:3]
    assert description.textures[table.base_color_texture].wrap_s == "mirror"
    assert [
        description.images[description.textures[t].image].srgb
        for t in (table.base_color_texture, table.metallic_roughness_texture)
    ] == [True, False]
    assert (table.base_color, table.roughness) == ((1, 1, 1), 0.3)
    assert (pane.kind, pane.ior) == ("glass", 1.45)
    assert (lamp.emission, lamp.double_sided) == ((12, 12, 12), True)
    assert (description.spheres[0].center, description.spheres[0].radius) == ((2, 5, 0), 4)
    geometry = flatten(description)
    placed = [geometry.position[geometry.triangle].reshape(-1, 3)]
    assert placed[0].max(axis=0)[0] == 7  # the first quad instance: x from 3 to 7
    assert placed[0].max(axis=0)[1] == 9  # the second: turned upright, y from 5 to 9
    assert description.materials[description.meshes[-1].material] is table
    assert description.warnings == []


def test_json_is_yaml_too(scene):
    assert len(scene("s.yaml", '{"shapes": [{"type": "quad"}], "name": "j"}').meshes) == 1


def test_a_mesh_file_keeps_its_own_materials_unless_told(scene):
    others = {"m.mtl": "newmtl red\nKd 1 0 0\n", "m.obj": "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n"}
    text = "materials: {blue: {color: [0, 0, 1]}}\nshapes: [{type: mesh, file: m.obj}, {type: mesh, file: m.obj, material: blue}]"
    description = scene("s.yaml", text, others)
    assert [description.materials[m.material].base_color for m in description.meshes] == [(1, 0, 0), (0, 0, 1)]


def test_a_mesh_file_that_is_shown_often_is_kept_once(scene, png):
    others = {"a.png": png(1, 2, 3), "m.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n"}
    shapes = ", ".join(f"{{type: mesh, file: m.obj, transform: [{{translate: [{i}, 0, 0]}}]}}" for i in range(5))
    description = scene("s.yaml", f"shapes: [{shapes}]", others)
    assert (len(description.meshes), len(description.materials), len(description.instances)) == (1, 1, 5)
    assert [i.transform[0, 3] for i in description.instances] == [0, 1, 2, 3, 4]
    assert description.images[0].name == "a.png"


@pytest.mark.parametrize(
    "shape", ["{type: quad}", "{type: disk}", "{type: cube}", "{type: lathe, profile: [[0, -1], [1, 0], [0, 1]]}"]
)
def test_shapes_face_out_with_normals_to_match(scene, shape):
    geometry = flatten(scene("s.yaml", f"shapes: [{shape}]"))
    corners = geometry.position[geometry.triangle]
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outwards = corners.mean(axis=1) if np.ptp(corners[..., 2]) > 0 else np.array([[0, 0, 1]])
    assert ((face * outwards).sum(axis=1) > 0).all()
    normals = geometry.normal[geometry.triangle]
    assert ((normals * face[:, None]).sum(axis=2) > 0).all()
    np.testing.assert_allclose(np.linalg.norm(geometry.normal, axis=1), 1, rtol=1e-5)


def test_shapes_have_the_areas_of_what_they_are(scene):
    for shape, area in (("quad", 4), ("cube", 24), ("disk", np.pi)):
        geometry = flatten(scene("s.yaml", f"shapes: [{{type: {shape}}}]"))
        corners = geometry.position[geometry.triangle].astype(np.float64)
        found = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
        assert found == pytest.approx(area, rel=2e-4)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        ("name: a\nshapes: ]", "line 2: is no YAML"),
        ("hello", "line 1: 'hello' is not of type 'object'"),
        ("name: x", "'shapes' is a required property"),
        ("shapes: []", "line 1: shapes:"),
        ("shapes:\n  - {type: blob}", "line 2: shapes[0].type: 'blob' is not one of"),
        ("shapes:\n  - type: sphere\n    radius: -1", "line 3: shapes[0].radius"),
        ("shapes:\n  - {type: mesh}", "line 2: shapes[0]: 'file' is a required property"),
        ("shapes:\n  - {type: mesh, file: gone.obj}", "line 2: shapes[0].file: gone.obj is not among the files"),
        ("shapes:\n  - {type: mesh, file: s.yaml}", "is no mesh file"),
        ("shapes:\n  - {type: quad}\n  - {type: quad, material: red}", "line 3: shapes[1].material: no material is called red"),
        ("materials:\n  m: {texture: t}\n" + QUAD, "line 2: materials.m.texture: no texture is called t"),
        ("materials:\n  m: {roughness: 2}\n" + QUAD, "line 2: materials.m.roughness: 2 is greater"),
        ("materials:\n  m: {colour: 1}\n" + QUAD, "line 2: materials.m: Additional properties"),
        ("materials:\n  m: {color: [1, .nan, 1]}\n" + QUAD, "line 2: materials.m.color[1]: .nan is not a finite"),
        ("materials:\n  m: {color: red}\n" + QUAD, "line 2: materials.m.color"),
        ("cameras:\n  - {eye: [0, 0, 0], target: [0, 0, 0]}\n" + QUAD, "line 2: cameras[0]: eye and target are the same"),
        ("cameras:\n  - {eye: [0, 0, 1e999], target: [0, 0, 0]}\n" + QUAD, "finite"),
        ("name: a\nname: b\n" + QUAD, "line 2: name stands here a second time"),
        ("shapes:\n  - type: sphere\n    transform: [{scale: [1, 2, 1]}]", "scaled alike"),
        (
            "shapes:\n  - type: quad\n    transform: [{rotate: {axis: [0, 0, 0], degrees: 3}}]",
            "line 3: shapes[0].transform[0].rotate",
        ),
        ("environment: {image: sky.exr}\n" + QUAD, "line 1: environment.image: sky.exr is not among"),
        ("textures: {t: {wrap: clamp}}\n" + QUAD, "one of image and checker"),
    ],
)
def test_errors_name_line_and_field(scene, text, said):
    with pytest.raises(SceneError) as caught:
        scene("s.yaml", text)
    assert said in str(caught.value)
    assert str(caught.value).startswith("s.yaml")


def test_aliases_that_stand_for_billions_are_refused(scene):
    bomb = "a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n"
    for here, before in zip("bcdefghi", "abcdefgh", strict=True):
        bomb += f"{here}: &{here} [{', '.join([f'*{before}'] * 10)}]\n"
    with pytest.raises(SceneError, match="aliases"):
        scene("s.yaml", bomb)


@pytest.mark.parametrize("bracket", ["[", "{a: ", "- "])
def test_nesting_without_end_is_refused(scene, bracket):
    with pytest.raises(SceneError, match="nested deeper"):
        scene("s.yaml", bracket * 200_000)


def test_an_alias_inside_itself_is_refused(scene):
    with pytest.raises(SceneError, match="nested deeper"):
        scene("s.yaml", "a: &a [*a]\n")


def test_the_documentations_example_is_a_scene(scene):
    text = (Path(__file__).parents[3] / "docs" / "scene-format.md").read_text()
    example = text.split("```yaml\n")[1].split("```")[0]
    assert "cup.glb" in example
    example = example.replace("cup.glb", "cup.obj").replace("image: sky.exr, ", "")
    description = scene("s.yaml", example, {"cup.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"})
    assert len(description.spheres) == 1


def test_the_documentation_names_every_field_of_the_schema():
    root = Path(__file__).parents[3]
    schema = json.loads((root / "renderer" / "scene" / "schema.json").read_text())
    text = (root / "docs" / "scene-format.md").read_text()

    def fields(part):
        if isinstance(part, dict):
            for key, value in part.items():
                if key == "properties":
                    yield from value
                yield from fields(value)
        elif isinstance(part, list):
            for value in part:
                yield from fields(value)

    missing = {name for name in fields(schema) if f"`{name}`" not in text and f"{name}:" not in text}
    assert missing == set()


@pytest.mark.parametrize("name", ["cornell-box", "spheres", "still-life"])
def test_our_example_scenes_read_without_a_warning(name):
    folder = Path(__file__).parents[3] / "scenes"
    assert (folder / f"{name}.yaml").stat().st_size < 300_000
    assert read(folder, f"{name}.yaml").warnings == []


def test_the_made_scenes_are_those_of_the_script():
    folder = Path(__file__).parents[3] / "scenes"
    made = runpy.run_path(str(folder / "make.py"))
    for name, scene in (("spheres", made["spheres"]()), ("still-life", made["still_life"]())):
        written = (folder / f"{name}.yaml").read_text().split("\n", 2)[2]
        assert written == made["text_of"](scene, "").split("\n", 2)[2]
