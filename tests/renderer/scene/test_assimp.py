"""Tests of formats read by assimp: Collada with all its features, and small files of older programs."""

import math
import re
import resource
import struct

import numpy as np
import pytest

from renderer.confine.limits import limited_memory
from renderer.errors import SceneError
from renderer.formats import LONG_TAIL
from renderer.scene.animation import Moment


def source(name, values, width, params):
    words = " ".join(map(str, values))
    accessor = "".join(f'<param name="{p}" type="float"/>' for p in params)
    return (
        f'<source id="{name}"><float_array id="{name}-a" count="{len(values)}">{words}</float_array><technique_common>'
        f'<accessor source="#{name}-a" count="{len(values) // width}" stride="{width}">{accessor}</accessor>'
        "</technique_common></source>"
    )


def geometry(name):
    points = source(f"{name}-p", [0, 0, 0, 1, 0, 0, 0, 1, 0], 3, "XYZ")
    return (
        f'<geometry id="{name}"><mesh>{points}<vertices id="{name}-v"><input semantic="POSITION" source="#{name}-p"/></vertices>'
        f'<triangles count="1" material="m"><input semantic="VERTEX" source="#{name}-v" offset="0"/><p>0 1 2</p></triangles>'
        "</mesh></geometry>"
    )


def placed(name):
    bound = '<bind_material><technique_common><instance_material symbol="m" target="#red"/></technique_common></bind_material>'
    return f'<instance_geometry url="#{name}">{bound}</instance_geometry>'


ANIMATION = (
    '<library_animations><animation id="a">'
    + source("times", [0, 1], 1, ["TIME"])
    + source("places", [0, 0, 0, 4, 0, 0], 3, "XYZ")
    + '<source id="ways"><Name_array id="ways-a" count="2">LINEAR LINEAR</Name_array><technique_common>'
    '<accessor source="#ways-a" count="2"><param name="INTERPOLATION" type="Name"/></accessor></technique_common></source>'
    '<sampler id="s"><input semantic="INPUT" source="#times"/><input semantic="OUTPUT" source="#places"/>'
    '<input semantic="INTERPOLATION" source="#ways"/></sampler><channel source="#s" target="mover/place"/>'
    "</animation></library_animations>"
)


def collada(up="Y_UP", meter=1.0):
    """Returns a Collada file with two geometries, one through a node library, a camera, two lights and an animation."""
    return (
        '<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">'
        f'<asset><unit name="u" meter="{meter}"/><up_axis>{up}</up_axis></asset>{ANIMATION}'
        '<library_cameras><camera id="c"><optics><technique_common><perspective><yfov>40</yfov><aspect_ratio>1.5</aspect_ratio>'
        "<znear>0.1</znear><zfar>100</zfar></perspective></technique_common></optics></camera></library_cameras>"
        '<library_lights><light id="sun"><technique_common><directional><color>1 0.5 0</color></directional></technique_common>'
        '</light><light id="lamp"><technique_common><point><color>1 1 1</color><constant_attenuation>0</constant_attenuation>'
        "<quadratic_attenuation>0.5</quadratic_attenuation></point></technique_common></light></library_lights>"
        '<library_effects><effect id="e"><profile_COMMON><technique sid="t"><lambert><diffuse><color>0.8 0.2 0.1 1</color>'
        "</diffuse></lambert></technique></profile_COMMON></effect></library_effects>"
        '<library_materials><material id="red" name="red"><instance_effect url="#e"/></material></library_materials>'
        f"<library_geometries>{geometry('g')}{geometry('h')}</library_geometries>"
        f'<library_nodes><node id="stock" name="stock"><translate>0 0 2</translate>{placed("h")}</node></library_nodes>'
        '<library_visual_scenes><visual_scene id="v">'
        f'<node id="mover" name="mover"><translate sid="place">0 0 0</translate>{placed("g")}</node>'
        '<node id="user" name="user"><translate>5 0 0</translate><instance_node url="#stock"/></node>'
        '<node id="eye" name="eye"><translate>0 0 9</translate><instance_camera url="#c"/></node>'
        '<node id="day" name="day"><instance_light url="#sun"/></node>'
        '<node id="bulb" name="bulb"><translate>0 3 0</translate><instance_light url="#lamp"/></node>'
        '</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#v"/></scene></COLLADA>'
    )


def corners(description):
    """Returns the world-space position of the first vertex of each instance, in sorted order."""
    return sorted(
        tuple((i.transform @ [*description.meshes[i.mesh].positions[0].tolist(), 1])[:3].round(5)) for i in description.instances
    )


def test_collada_with_all_features(scene):
    description = scene("a.dae", collada())
    assert corners(description) == [(0, 0, 0), (5, 0, 2)]
    assert [m.base_color for m in description.materials] == [pytest.approx((0.8, 0.2, 0.1))]
    (camera,) = description.cameras
    assert camera.view.eye == pytest.approx((0, 0, 9))
    assert camera.view.fov == pytest.approx(40, abs=1e-4)
    assert np.subtract(camera.view.target, camera.view.eye)[2] < 0
    lights = {light.name: light for light in description.lights}
    assert lights["day"].direction == pytest.approx((0, 0, -1))
    assert lights["day"].intensity == pytest.approx([math.pi, math.pi / 2, 0])
    assert lights["bulb"].position == pytest.approx((0, 3, 0))
    assert lights["bulb"].intensity == pytest.approx([2 * math.pi] * 3)


def test_collada_camera_values(scene):
    """Cameras of Collada files have the file's values, even those that assimp ignores.

    These are the orthographic size, the near plane and Blender's lens shift.
    """
    wide, tall = "<aspect_ratio>1.6</aspect_ratio>", "<aspect_ratio>0.5</aspect_ratio>"
    shift = '<extra><technique profile="blender"><shiftx>0.1</shiftx><shifty>-0.2</shifty></technique></extra>'
    for optics, more, expected in (
        ("<perspective><yfov>40</yfov><znear>0.1</znear></perspective>", "", ("perspective", 40, 0.1, 0, 0)),
        (f"<perspective><xfov>60</xfov>{wide}</perspective>", shift, ("perspective", 39.68, 0, 0.16, -0.32)),
        (f"<orthographic><xmag>3.5</xmag>{wide}<znear>2</znear></orthographic>", "", ("orthographic", 4.375, 2, 0, 0)),
        (f"<orthographic><ymag>3</ymag>{tall}</orthographic>", shift, ("orthographic", 6, 0, 0.1, -0.2)),
    ):  # fmt: skip
        said = f'<library_cameras><camera id="c"><optics><technique_common>{optics}</technique_common></optics>{more}</camera>'
        text = re.sub(r"<library_cameras>.*</camera>", said, collada())
        (camera,) = scene("a.dae", text).cameras
        view = camera.view
        size = view.height if view.projection == "orthographic" else view.fov
        got = view.projection, round(size, 3), view.near, view.shift_x, view.shift_y
        assert got == (expected[0], *(pytest.approx(each, abs=1e-2) for each in expected[1:])), optics


@pytest.mark.parametrize("odd", ["-0.7994", "1e9", "-1", "x"])
def test_non_numeric_collada_corners_are_rejected(scene, odd):
    with pytest.raises(
        SceneError, match=f"a.dae: a list of corners .<p>. contains '{odd}', which is not an index; export the file again"
    ):
        scene("a.dae", collada().replace("<p>0 1 2</p>", f"<p>0 1 {odd}</p>"))


def test_collada_animation(scene):
    description = scene("a.dae", collada(), moment=Moment(12))
    assert corners(description) == [(2, 0, 0), (5, 0, 2)]
    assert [(clip.start, clip.end) for clip in description.clips] == [(0, 1)]
    assert [i.moves for i in description.instances] == [True, False]
    assert description.moves


def test_blender_collada_light_power(scene):
    own = {"red": 1, "green": 0.5, "blue": 0, "energy": 4 * math.pi, "spotsize": 60, "spotblend": 0}
    extra = "".join(f'<{name} sid="{name}" type="float">{value}</{name}>' for name, value in own.items())
    extra = f'<extra><technique profile="blender">{extra}</technique></extra>'
    spot = "<technique_common><spot><color>9 9 9</color></spot></technique_common>"
    text = collada().decode() if isinstance(collada(), bytes) else collada()
    start, _, end = text.partition('<light id="lamp">')
    end = end.partition("</light>")[2]
    found = scene("a.dae", f'{start}<light id="lamp">{spot}{extra}</light>{end}')
    bulb = next(light for light in found.lights if light.name == "bulb")
    assert bulb.kind == "spot"
    assert bulb.intensity == pytest.approx((1, 0.5, 0))
    assert (bulb.inner_cone, bulb.outer_cone) == pytest.approx((30, 30))
    assert next(light for light in found.lights if light.name == "day").intensity == pytest.approx([math.pi, math.pi / 2, 0])


def test_collada_unit_and_up_axis(scene):
    description = scene("a.dae", collada("Z_UP", 0.01))
    assert corners(description) == [(0, 0, 0), (5, 2, 0)]


def test_collada_nodes_sharing_a_geometry(scene):
    """Nodes that share a geometry have their own materials and transforms, for files of every up axis.

    Positions equal, to 2e-6, what Blender reads from the same files.
    """
    text = collada("Z_UP").replace(
        "</library_materials>", '<material id="blue" name="blue"><instance_effect url="#f"/></material></library_materials>'
    )
    effect = '<effect id="f"><profile_COMMON><technique sid="t"><lambert><diffuse><color>0 0 1 1</color></diffuse></lambert>'
    text = text.replace("</library_effects>", f"{effect}</technique></profile_COMMON></effect></library_effects>")
    turned = "<matrix>0 -1 0 7 1 0 0 0 0 0 -2 3 0 0 0 1</matrix>"
    twin = f'<node id="twin">{turned}{placed("g").replace("#red", "#blue")}</node></visual_scene>'
    found = scene("a.dae", text.replace("</visual_scene>", twin))
    shown = {i.name: i for i in found.instances}
    mesh = {name: found.meshes[i.mesh] for name, i in shown.items()}
    assert found.materials[mesh["mover"].material].base_color == pytest.approx((0.8, 0.2, 0.1))
    assert found.materials[mesh["twin"].material].base_color == pytest.approx((0, 0, 1))
    points = mesh["twin"].positions @ shown["twin"].transform[:3, :3].T + shown["twin"].transform[:3, 3]
    np.testing.assert_allclose(
        points, [(7, 3, 0), (7, 3, -1), (6, 3, 0)], atol=1e-6
    )  # Z up becomes Y up: (x, y, z) to (x, z, -y)


def test_collada_rejected_by_assimp_is_read_by_trimesh(scene):
    description = scene("a.dae", collada().replace('source="#times"', 'source="#gone"'))
    assert len(description.instances) == 2
    assert any("without its cameras, lights and animation" in w for w in description.warnings)


def test_ac3d(scene):
    text = (
        'AC3Db\nMATERIAL "blue" rgb 0.1 0.2 0.8 amb 0.2 0.2 0.2 emis 0 0 0 spec 0.5 0.5 0.5 shi 10 trans 0.25\n'
        "OBJECT world\nkids 1\nOBJECT poly\nloc 0 1 0\nnumvert 3\n0 0 0\n1 0 0\n0 1 0\nnumsurf 1\nSURF 0x20\nmat 0\n"
        "refs 3\n0 0 0\n1 1 0\n2 0 1\nkids 0\n"
    )
    description = scene("a.ac", text)
    assert corners(description) == [(0, 1, 0)]
    material = description.materials[description.meshes[0].material]
    assert material.base_color == pytest.approx((0.1, 0.2, 0.8))
    assert (material.opacity, material.alpha_mode) == (pytest.approx(0.75), "blend")


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig"])
def test_utf16_and_bom_are_decoded(scene, encoding):
    text = (
        'AC3Db\nMATERIAL "m" rgb 1 1 1 amb 1 1 1 emis 0 0 0 spec 0 0 0 shi 0 trans 0\nOBJECT world\nkids 1\nOBJECT poly\n'
        "numvert 3\n0 0 0\n1 0 0\n0 1 0\nnumsurf 1\nSURF 0x20\nmat 0\nrefs 3\n0 0 0\n1 1 0\n2 0 1\nkids 0\n"
    )
    assert corners(scene("a.ac", text.encode(encoding))) == [(0, 0, 0)]


def test_x3d(scene):
    text = (
        '<?xml version="1.0"?><X3D version="3.0"><Scene><Transform translation="2 0 0"><Shape><Appearance>'
        '<Material diffuseColor="0.2 0.7 0.1"/></Appearance><IndexedFaceSet coordIndex="0 1 2 -1">'
        '<Coordinate point="0 0 0 1 0 0 0 1 0"/></IndexedFaceSet></Shape></Transform></Scene></X3D>'
    )
    description = scene("a.x3d", text)
    assert corners(description) == [(2, 0, 0)]
    assert description.materials[description.meshes[0].material].base_color == pytest.approx((0.2, 0.7, 0.1))


def chunk(number, *parts):
    body = b"".join(parts)
    return struct.pack("<HI", number, 6 + len(body)) + body


def test_3ds(scene):
    points = chunk(0x4110, struct.pack("<H9f", 3, 0, 0, 0, 1, 0, 0, 0, 1, 0))
    faces = chunk(0x4120, struct.pack("<H4H", 1, 0, 1, 2, 0), chunk(0x4130, b"red\0", struct.pack("<HH", 1, 0)))
    color = chunk(0xA020, chunk(0x0011, bytes((255, 0, 51))))
    material = chunk(0xAFFF, chunk(0xA000, b"red\0"), color)
    light = chunk(0x4000, b"lamp\0", chunk(0x4600, struct.pack("<3f", 0, 0, 7)))
    tri = chunk(0x4000, b"tri\0", chunk(0x4100, points, faces))
    description = scene("a.3ds", chunk(0x4D4D, chunk(0x3D3D, material, tri, light)))
    world = description.instances[0].transform @ np.array([0, 1, 0, 1])
    assert world[:3] == pytest.approx((0, 0, -1), abs=1e-6)  # Z is up in the file
    assert description.materials[0].base_color == pytest.approx((1, 0, 0.2))
    assert description.lights[0].position == pytest.approx((0, 7, 0), abs=1e-5)


def test_texture_is_found_beside_the_file(scene, png):
    text = (
        'AC3Db\nMATERIAL "m" rgb 1 1 1 amb 1 1 1 emis 0 0 0 spec 0 0 0 shi 0 trans 0\nOBJECT world\nkids 1\nOBJECT poly\n'
        'texture "../pictures/wood.png"\nnumvert 3\n0 0 0\n1 0 0\n0 1 0\nnumsurf 1\nSURF 0x20\nmat 0\nrefs 3\n'
        "0 0 0\n1 1 0\n2 0 1\nkids 0\n"
    )
    assert any("wood.png is not among the files; add it" in w for w in scene("a.ac", text).warnings)
    found = scene("b.ac", text, {"wood.png": png(255, 0, 0)})
    assert found.images[0].pixels[0, 0].tolist() == [255, 0, 0, 255]


@pytest.mark.parametrize("suffix", LONG_TAIL)
def test_invalid_file_is_an_error_message(scene, suffix):
    for data in (b"", b"hello", bytes(range(256)) * 8):
        with pytest.raises(SceneError, match=rf"a\{suffix}[: ]"):
            scene(f"a{suffix}", data)


def test_entities_are_refused(scene):
    with pytest.raises(SceneError, match="entities"):
        scene("a.x3d", '<!DOCTYPE x [<!ENTITY a "b">]><X3D/>')


def x3d(appearance, more=""):
    """Returns an X3D file of one triangle with texture coordinates, with the given appearance node and further nodes."""
    return (
        f'<?xml version="1.0"?><X3D profile="Interchange" version="3.3"><Scene>{more}<Shape><Appearance>{appearance}</Appearance>'
        '<IndexedFaceSet coordIndex="0 1 2 -1" texCoordIndex="0 1 2 -1"><Coordinate point="0 0 0 1 0 0 0 1 0"/>'
        '<TextureCoordinate point="0 0 1 0 0 1"/></IndexedFaceSet></Shape></Scene></X3D>'
    )


def test_x3d_texture_transform(scene, png):
    """An X3D TextureTransform maps coordinates by Tc' = S R T Tc (ISO/IEC 19775-1, 18.4.8)."""
    said = '<ImageTexture url="t.png"/><TextureTransform scale="2 3" translation="0.1 0.2" rotation="0.5"/>'
    found = scene("a.x3d", x3d(said), {"t.png": png(200, 100, 50)})
    look = found.materials[found.meshes[0].material]
    assert look.base_color == (1, 1, 1)  # without a diffuse colour in the file the texture is unscaled
    rows = np.array(found.textures[look.base_color_texture].transform).reshape(2, 3)
    s, t = 0.3, 0.9
    u, v = rows @ (s, 1 - t, 1)
    turn = np.array([[math.cos(0.5), -math.sin(0.5)], [math.sin(0.5), math.cos(0.5)]])
    np.testing.assert_allclose((u, 1 - v), (2, 3) * (turn @ (s + 0.1, t + 0.2)), atol=1e-6)


def test_x3d_viewpoints_cause_a_warning(scene):
    found = scene("a.x3d", x3d("", '<Viewpoint position="0 0 5"/>'))
    assert any("1 viewpoints, which are X3D's cameras" in w for w in found.warnings)


def test_smd_file_is_not_read_as_animation_list(scene):
    frames = "\n".join(f"time {t}\n0 {t} 0 0 0 0 0" for t in range(3))
    corner = "\n".join(f"0 {x} {y} 0 0 0 1 {x} {y}" for x, y in ((0, 0), (1, 0), (0, 1)))
    found = scene("a.smd", f'version 1\nnodes\n0 "root" -1\nend\nskeleton\n{frames}\nend\ntriangles\nm.bmp\n{corner}\nend\n')
    assert len(found.clips) == 1


def warned(description, sentence):
    return any(sentence in warning for warning in description.warnings)


def test_content_skipped_by_assimp_is_counted(scene):
    tcb = chunk(0xB020, struct.pack("<HIIH", 0x8, 0, 0, 1), struct.pack("<IHf3f", 0, 1, 0.5, 0, 0, 0))
    points = chunk(0x4110, struct.pack("<H9f", 3, 0, 0, 0, 1, 0, 0, 0, 1, 0))
    faces = chunk(0x4120, struct.pack("<H4H", 1, 0, 1, 2, 0))
    tri = chunk(0x4000, b"tri\0", chunk(0x4100, points, faces))
    moved = chunk(0xB000, chunk(0xB002, chunk(0xB010, b"tri\0", struct.pack("<3H", 0, 0, 0xFFFF)), tcb))
    found = scene("a.3ds", chunk(0x4D4D, chunk(0x3D3D, tri), moved))
    assert warned(found, "importer message: 3DS: Skipping TCB animation info")


def test_unread_material_properties_are_counted(scene):
    lambert = (
        "</diffuse><reflectivity><float>0.5</float></reflectivity><index_of_refraction><float>2</float></index_of_refraction>"
    )
    text = collada().replace("lambert>", "phong>").replace("</diffuse>", lambert)
    found = scene("a.dae", text)
    assert warned(found, "1 properties of materials: reflectivity")
    assert warned(found, "1 properties of materials: refracti")
    assert not warned(scene("b.dae", collada()), "properties of materials")


def test_nonquadratic_light_falloff_causes_a_warning(scene):
    text = collada().replace("<quadratic_attenuation>0.5", "<linear_attenuation>1</linear_attenuation><quadratic_attenuation>0")
    assert warned(scene("a.dae", text), "1 light falloffs other than inverse square")


def test_separate_animation_files_cause_a_warning(scene):
    mesh = (
        'MD5Version 10\ncommandline ""\n\nnumJoints 1\nnumMeshes 1\n\njoints {\n\t"origin" -1 ( 0 0 0 ) ( 0 0 0 )\n}\n\nmesh {\n'
        '\tshader "m"\n\tnumverts 3\n\tvert 0 ( 0 0 ) 0 1\n\tvert 1 ( 1 0 ) 1 1\n\tvert 2 ( 0 1 ) 2 1\n\tnumtris 1\n'
        "\ttri 0 0 1 2\n\tnumweights 3\n\tweight 0 0 1 ( 0 0 0 )\n\tweight 1 0 1 ( 1 0 0 )\n\tweight 2 0 1 ( 0 1 0 )\n}\n"
    )
    assert not warned(scene("a.md5mesh", mesh), "frames")
    assert warned(scene("a.md5mesh", mesh, {"walk.md5anim": b"MD5Version 10"}), "1 frames, of which only the first is shown")


def test_empty_file_is_reported_after_other_files(scene):
    with pytest.raises(SceneError, match="damaged"):
        scene("a.3ds", b"hello")
    with pytest.raises(SceneError, match=r"b\.x is empty"):
        scene("b.x", b"")


def test_importer_memory_is_limited():
    before = resource.getrlimit(resource.RLIMIT_AS)
    with limited_memory(256 << 20):
        with pytest.raises(MemoryError):
            bytearray(512 << 20)
        bytearray(16 << 20)
    assert resource.getrlimit(resource.RLIMIT_AS) == before
