"""Tests of 3MF: components, colours of triangles and corners, textures, parts of a package."""

import io
import zipfile

import numpy as np
import pytest

from renderer.errors import SceneError
from renderer.scene.load import read
from renderer.scene.readers.threemf_rows import cut_out

NAMES = (
    'unit="millimeter" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02" '
    'xmlns:m="http://schemas.microsoft.com/3dmanufacturing/material/2015/02" '
    'xmlns:p="http://schemas.microsoft.com/3dmanufacturing/production/2015/06"'
)
RELATIONS = (
    '<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship Target="/3D/main.model" '
    'Id="r" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/></Relationships>'
)
MESH = (
    '<mesh><vertices><vertex x="0" y="0" z="0"/><vertex x="10" y="0" z="0"/><vertex x="0" y="10" z="0"/>'
    '<vertex x="0" y="0" z="10"/></vertices><triangles>{}</triangles></mesh>'
)


def model(resources, build):
    return f'<?xml version="1.0"?><model {NAMES}><resources>{resources}</resources><build>{build}</build></model>'


def package(text, **others):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as made:
        made.writestr("_rels/.rels", RELATIONS)
        made.writestr("3D/main.model", text)
        for name, data in others.items():
            made.writestr(name.replace("__", "/"), data)
    return out.getvalue()


def solid(number=1, triangles='<triangle v1="0" v2="1" v3="2"/>', **said):
    words = " ".join(f'{key}="{value}"' for key, value in said.items())
    return f'<object id="{number}" {words}>{MESH.format(triangles)}</object>'


def test_component_transforms(scene):
    group = '<object id="2"><components><component objectid="1" transform="0 1 0 -1 0 0 0 0 1 5 0 0"/></components></object>'
    place = '<item objectid="2" transform="1 0 0 0 1 0 0 0 1 0 0 100"/><item objectid="1"/>'
    description = scene("a.3mf", package(model(solid() + group, place)))
    assert len(description.meshes) == 1
    first, second = (i.transform @ [10, 0, 0, 1] for i in description.instances)
    # (10, 0, 0) rotated by 90 degrees about Z is (0, 10, 0), translated (5, 10, 100); Z is up.
    assert first[:3] == pytest.approx((5, 100, -10))
    assert second[:3] == pytest.approx((10, 0, 0))


def test_base_materials_of_objects_and_of_triangles(scene):
    bases = '<base name="red" displaycolor="#FF0000"/><base name="pane" displaycolor="#00FF0080"/>'
    bases = f'<basematerials id="7">{bases}</basematerials>'
    triangles = '<triangle v1="0" v2="1" v3="2"/><triangle v1="0" v2="1" v3="3" pid="7" p1="1"/>'
    description = scene("a.3mf", package(model(bases + solid(1, triangles, pid=7, pindex=0), '<item objectid="1"/>')))
    found = {
        description.materials[m.material].name: (description.materials[m.material], len(m.triangles)) for m in description.meshes
    }
    assert found["red"][0].base_color == pytest.approx((1, 0, 0))
    assert found["red"][1] == found["pane"][1] == 1
    assert (found["pane"][0].opacity, found["pane"][0].alpha_mode) == (pytest.approx(128 / 255), "blend")


def test_colours_of_corners(scene):
    colors = '<m:colorgroup id="8"><m:color color="#FF0000"/><m:color color="#00FF00"/><m:color color="#0000FF"/></m:colorgroup>'
    triangles = '<triangle v1="0" v2="1" v3="2" pid="8" p1="0" p2="1" p3="2"/><triangle v1="0" v2="1" v3="3" pid="8" p1="1"/>'
    description = scene("a.3mf", package(model(colors + solid(1, triangles), '<item objectid="1"/>')))
    (mesh,) = description.meshes
    assert mesh.colors[mesh.triangles[0], :3].tolist() == [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert mesh.colors[mesh.triangles[1], :3].tolist() == [[0, 1, 0]] * 3


def test_package_texture(scene, png):
    textures = (
        '<m:texture2d id="5" path="/3D/Textures/wood.png" contenttype="image/png" tilestyleu="clamp"/>'
        '<m:texture2dgroup id="9" texid="5"><m:tex2coord u="0" v="1"/><m:tex2coord u="1" v="1"/><m:tex2coord u="0" v="0"/>'
        "</m:texture2dgroup>"
    )
    text = model(textures + solid(1, '<triangle v1="0" v2="1" v3="2" pid="9" p1="0" p2="1" p3="2"/>'), '<item objectid="1"/>')
    description = scene("a.3mf", package(text, **{"3D__Textures__wood.png": png(255, 0, 0)}))
    (mesh,) = description.meshes
    assert mesh.uvs[mesh.triangles[0]].tolist() == [[0, 0], [1, 0], [0, 1]]  # v runs from the upper edge
    texture = description.textures[description.materials[mesh.material].base_color_texture]
    assert (texture.wrap_s, texture.wrap_t) == ("clamp", "repeat")
    missing = scene("b.3mf", package(text))
    assert any("wood.png is not among the files" in w for w in missing.warnings)


def test_object_in_another_model_part(scene):
    other = '<object id="2"><components><component objectid="4" p:path="/3D/Objects/part.model"/></components></object>'
    part = model(solid(4), "")
    data = package(model(other, '<item objectid="2"/>'), **{"3D__Objects__part.model": part})
    assert [len(m.triangles) for m in scene("a.3mf", data).meshes] == [1]


def test_slicer_filament_colors(scene):
    """Filament colours of slicers (Bambu Studio, Orca) apply to objects and their parts; brush painting causes a warning."""
    parts = '<component objectid="1"/><component objectid="3"/>'
    objects = solid() + solid(3, '<triangle v1="0" v2="1" v3="2" paint_color="8"/>')
    resources = f'{objects}<object id="2"><components>{parts}</components></object>'
    said = '<metadata key="name" value="Cup"/><metadata key="extruder" value="{}"/>'
    config = f'<config><object id="2">{said.format(2)}<part id="3">{said.format(3)}</part></object></config>'
    files = {
        "Metadata__model_settings.config": config,
        "Metadata__project_settings.config": '{"filament_colour": ["#FFFFFF", "#FF0000", "#0000FFFF"]}',
    }
    found = scene("a.3mf", package(model(resources, '<item objectid="2"/>'), **files))
    assert [found.materials[m.material].base_color for m in found.meshes] == [(1, 0, 0), (0, 0, 1)]
    assert any("colours painted in a slicer" in w for w in found.warnings)
    for damaged in ({"Metadata__model_settings.config": "<config"}, {"Metadata__project_settings.config": "[3"}):
        whole = scene("a.3mf", package(model(resources, '<item objectid="2"/>'), **files | damaged))
        assert whole.materials[0].base_color == (0.8, 0.8, 0.8)


@pytest.mark.parametrize(
    ("resources", "build", "says"),
    [
        ("", '<item objectid="3"/>', "refers to object 3, which does not exist"),
        (
            '<object id="1"><components><component objectid="1"/></components></object>',
            '<item objectid="1"/>',
            "contain each other",
        ),
        (solid(1, '<triangle v1="0" v2="1" v3="9"/>'), '<item objectid="1"/>', "a triangle refers to vertex 9, but there are 4"),
        (solid(), '<item objectid="1" transform="1 0 nan"/>', "twelve finite numbers"),
        (solid(1, '<triangle v1="0" v2="1"/>'), '<item objectid="1"/>', "is damaged"),
    ],
)
def test_damage_is_an_error_message(scene, resources, build, says):
    with pytest.raises(SceneError, match=f"a.3mf[: ].*{says}"):
        scene("a.3mf", package(model(resources, build)))


def test_non_package_is_an_error_message(scene):
    for data in (b"", b"PK\x03\x04" + bytes(40), package("<model")):
        with pytest.raises(SceneError, match=r"a\.3mf[: ]"):
            scene("a.3mf", data)
    with pytest.raises(SceneError, match="entities"):
        scene("a.3mf", package('<!DOCTYPE m [<!ENTITY a "b">]><model/>'))


def test_damaged_packages_are_read_or_rejected(tmp_path):
    data = np.frombuffer(package(model(solid(), '<item objectid="1"/>')), np.uint8)
    rng = np.random.default_rng(3)
    for _ in range(150):
        damaged = data.copy()
        damaged[rng.integers(len(data), size=rng.integers(1, 6))] = rng.integers(256)
        (tmp_path / "a.3mf").write_bytes(damaged.tobytes())
        try:
            read(tmp_path, "a.3mf")
        except SceneError as error:
            assert str(error).startswith(("a.3mf: ", "a.3mf "))
            assert "could not be read as" not in str(error)


def rows(count, odd=""):
    """Returns a 3MF mesh of a strip with `count` vertices. odd: text inserted into the first vertex element."""
    points = "\n".join(f'<vertex x="{i % 3}.{i}e-1" y="-{i}" z="{i * i}"/>' for i in range(count))
    faces = "".join(f'<triangle v1="{i}" v2="{i + 1}" v3="{i + 2}" p1="{i % 2}"/>\n' for i in range(count - 2))
    return f"<mesh><vertices>\n{points.replace('<vertex ', '<vertex' + odd, 1)}\n</vertices><triangles>{faces}</triangles></mesh>"


def test_uniform_rows_are_parsed_quickly_and_equally(scene):
    base = '<basematerials id="5"><base name="a" displaycolor="#FF0000"/><base name="b" displaycolor="#00FF00"/></basematerials>'
    found = []
    for odd in (" ", "  "):
        text = model(base + f'<object id="1" pid="5" pindex="0">{rows(50, odd)}</object>', '<item objectid="1"/>')
        found.append(scene("a.3mf", package(text)))
    assert len(found[0].meshes) == 2
    for other in found[1:]:
        for mesh, same in zip(found[0].meshes, other.meshes, strict=True):
            np.testing.assert_array_equal(mesh.positions, same.positions)
            np.testing.assert_array_equal(mesh.triangles, same.triangles)


@pytest.mark.parametrize(
    ("text", "names"),
    [
        (b'<vertex x="1" y="2" z="3"/>\n<vertex x="4" y="5" z="6"/>', ["x", "y", "z"]),
        (b'<m:vertex z="1" y="2" x="3" /><m:vertex z="4" y="5" x="6" />', ["z", "y", "x"]),  # a space before the end of the tag
        (b'<vertex x="1" y="2" z="3"/><vertex x="4" y="5" z="6" />', None),
        (b'<vertex x="1" y="2" z="3"/><vertex x="4" z="5" y="6"/>', None),
        (b'<vertex x="1" y="2" z="3"/><vertex x="4" y="5 6" z="7"/>', None),
        (b'<vertex x="1" y="2" z="3"/><!-- "x" "y" "z" --><vertex x="4" y="5" z="7"/>', None),
        (b'<vertex x="1" y="&two;" z="3"/>', None),
        (b'<vertex x="1" x="2" z="3"/>', None),
        (b'<vertex x="" y="2" z="3"/>', None),
        (b'<vertices x="1" y="2" z="3"/>', None),
        (b"", None),
    ],
)
def test_irregular_rows_are_left_to_the_xml_parser(text, names):
    slim, found = cut_out(b"<mesh><vertices>" + text + b"</vertices></mesh>")
    assert ([*found[0].columns] if found else None) == names
    assert (text in slim) == (names is None)


@pytest.mark.parametrize(
    "before",
    [
        '<object id="9"><mesh><vertices/><triangles/></mesh></object>',
        f"<!-- {MESH.format('')} -->",
        MESH.format("").replace("<vertices>", '<vertices count="4">').join(('<object id="9">', "</object>")),
    ],
)
def test_cut_out_lists_are_assigned_to_their_objects(scene, before):
    (mesh,) = scene("a.3mf", package(model(before + solid(), '<item objectid="1"/>'))).meshes
    assert (len(mesh.positions), len(mesh.triangles)) == (3, 1)


def boxes(first, second):
    """Returns a 3MF package with an object of two parts, whose subtypes in the slicer's settings are `first` and `second`."""
    config = f'<config><object id="3"><part id="1" subtype="{first}"/><part id="2" subtype="{second}"/></object></config>'
    group = '<object id="3"><components><component objectid="1"/><component objectid="2"/></components></object>'
    text = model(solid(1, name="body") + solid(2, name="cut") + group, '<item objectid="3"/>')
    return package(text, Metadata__model_settings_config=config).replace(b"settings_config", b"settings.config")


@pytest.mark.parametrize(
    ("subtype", "said"),
    [
        ("negative_part", "1 negative parts"),
        ("modifier_part", "1 modifiers"),
        ("support_blocker", "1 support blockers"),
        ("support_enforcer", "1 support enforcers"),
    ],
)
def test_unprinted_parts_are_omitted_and_counted(scene, subtype, said):
    description = scene("a.3mf", boxes("normal_part", subtype))
    assert [i.name for i in description.instances] == ["body"]
    assert any(said in w for w in description.warnings)


@pytest.mark.parametrize("kind", ["NegativeVolume", "ParameterModifier", "SupportBlocker", "SupportEnforcer"])
def test_unprinted_volumes_are_omitted_and_counted(scene, kind):
    config = '<config><object id="1"><volume firstid="0" lastid="0"><metadata key="volume_type" value="ModelPart"/></volume>'
    config += f'<volume firstid="1" lastid="2"><metadata key="volume_type" value="{kind}"/></volume></object></config>'
    rows = '<triangle v1="0" v2="1" v3="2"/><triangle v1="0" v2="1" v3="3"/><triangle v1="0" v2="2" v3="3"/>'
    data = package(model(solid(1, rows), '<item objectid="1"/>'), Metadata__Slic3r_PE_model_config=config)
    description = scene("a.3mf", data.replace(b"model_config", b"model.config"))
    assert len(description.meshes[0].triangles) == 1
    assert any("parts that are not printed are left out: 1 " in w for w in description.warnings)


def test_unprinted_objects_are_omitted(scene):
    blocker = solid(3).replace(
        "<mesh>", '<metadatagroup><metadata name="cura:anti_overhang_mesh">True</metadata></metadatagroup><mesh>'
    )
    items = "".join(f'<item objectid="{k}"/>' for k in (1, 2, 3))
    description = scene("a.3mf", package(model(solid(1) + solid(2, type="other") + blocker, items)))
    assert len(description.instances) == 1
    assert any("1 objects of the type other, 1 support blockers" in w for w in description.warnings)


def test_object_of_two_materials_has_no_seam(scene):
    bases = '<basematerials id="7"><base name="a" displaycolor="#FF0000"/><base name="b" displaycolor="#00FF00"/></basematerials>'
    mesh = '<mesh><vertices><vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/><vertex x="0.5" y="1" z="0.2"/>'
    mesh += '<vertex x="0.5" y="-1" z="0.2"/></vertices><triangles><triangle v1="0" v2="1" v3="2" pid="7" p1="0"/>'
    mesh += '<triangle v1="1" v2="0" v3="3" pid="7" p1="1"/></triangles></mesh>'
    description = scene("a.3mf", package(model(f'{bases}<object id="1">{mesh}</object>', '<item objectid="1"/>')))
    assert len(description.meshes) == 2
    for found in description.meshes:
        edge = np.abs(found.positions[:, 1]) < 1e-6
        np.testing.assert_allclose(
            found.normals[edge] / np.linalg.norm(found.normals[edge], axis=1)[:, None], [(0, 0, 1)] * 2, atol=1e-6
        )
