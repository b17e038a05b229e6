"""Tests of Mitsuba's XML: what is read, what a warning names, and what is refused. tests/peers compares pictures."""

from __future__ import annotations

import random
import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from renderer.errors import SceneError
from renderer.image.encode import write
from renderer.scene.description import SceneDescription
from renderer.scene.load import read
from renderer.scene.readers.mitsuba.values import Spectrum
from renderer.scene.tangents import vertex_tangents
from tests.peers.test_mitsuba_files import SHAPES, write_files

BALL = '<shape type="sphere">{}</shape>'


def scene_of(folder: Path, inside: str, version: str = "3.0.0") -> SceneDescription:
    (folder / "scene.xml").write_text(f'<scene version="{version}">{inside}</scene>')
    return read(folder, "scene.xml")


def test_mitsuba_06_names_defaults_and_film(tmp_path: Path) -> None:
    found = scene_of(
        tmp_path,
        '<default name="n" value="12"/><sensor type="perspective"><float name="fov" value="60"/><transform name="toWorld">'
        '<lookAt origin="0 0 5" target="0 0 0" up="0 1 0"/></transform><sampler type="ldsampler">'
        '<integer name="sampleCount" value="$n"/></sampler><film type="hdrfilm"><integer name="width" value="200"/>'
        '<integer name="height" value="100"/></film></sensor><integrator type="path"><integer name="maxDepth" value="7"/>'
        "</integrator>"
        + BALL.format('<bsdf type="dielectric"><string name="intIOR" value="water"/></bsdf><float name="radius" value="2"/>'),
        "0.6.0",
    )
    assert found.defaults == {"width": 200, "height": 100, "spp": 12, "max_depth": 7, "transmission_depth": 0, "filter": "tent"}
    view = found.cameras[0].view
    assert view.eye == (0, 0, 5)
    assert np.tan(np.radians(view.fov / 2)) == pytest.approx(np.tan(np.radians(30)) / 2)  # Mitsuba's fov is horizontal
    assert found.spheres[0].radius == 2


def test_lens_shift_and_spot(tmp_path: Path) -> None:
    """Principal point offsets of a lens, and a spot light, are read.

    The offsets are fractions of the film's width and height, to the right and down.
    """
    found = scene_of(
        tmp_path,
        '<sensor type="perspective"><float name="principal_point_offset_x" value="0.1"/>'
        '<float name="principal_point_offset_y" value="0.25"/>'
        '<film type="hdrfilm"><integer name="width" value="200"/><integer name="height" value="100"/></film></sensor>'
        '<emitter type="spot"><float name="cutoff_angle" value="30"/></emitter>' + BALL.format(""),
    )
    assert (found.cameras[0].view.shift_x, found.cameras[0].view.shift_y) == pytest.approx((0.2, -0.25))
    (light,) = found.lights
    assert (light.falloff, light.outer_cone, light.inner_cone) == ("linear", 30, 22.5)
    assert not found.warnings


def test_serialized_mesh_file(tmp_path: Path) -> None:
    def packed(offset: float, flags: int) -> bytes:
        vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, offset]], "<f4")
        body = struct.pack("<I", flags) + b"sheet\0" + struct.pack("<QQ", 3, 1) + vertices.tobytes()
        body += np.array([0, 1, 2], "<u4").tobytes()
        return struct.pack("<HH", 0x041C, 4) + zlib.compress(body)

    first, second = packed(1, 0x1000), packed(2, 0x1000)
    table = struct.pack("<QQI", 0, len(first), 2)
    (tmp_path / "m.serialized").write_bytes(first + second + table)
    shape = (
        '<shape type="serialized"><string name="filename" value="m.serialized"/><integer name="shape_index" value="{}"/></shape>'
    )
    assert scene_of(tmp_path, shape.format(1)).meshes[0].positions[2].tolist() == [0, 1, 2]
    with pytest.raises(SceneError, match="has 2 meshes"):
        scene_of(tmp_path, shape.format(2))
    (tmp_path / "m.serialized").write_bytes(first[:-9] + table)
    with pytest.raises(SceneError, match="is damaged"):
        scene_of(tmp_path, shape.format(0))


def test_flat_and_red_spectra() -> None:
    np.testing.assert_allclose(Spectrum([300, 900], [0.4, 0.4]).rgb(False), 0.4, rtol=1e-6)
    r, g, b = Spectrum([400, 580, 620, 700], [0, 0, 0.8, 0.8]).rgb(False)
    assert r > 0.3 and g < 0.2 and b < 0.05


@pytest.mark.parametrize(
    ("inside", "sentence"),
    [
        (
            BALL.format('<bsdf type="normalmap"><bsdf type="diffuse"/></bsdf>'),
            "Normal maps have no shadowing function here; to compare, set it to false in Mitsuba",
        ),
        (BALL.format("") + '<shape type="sdfgrid"/>' * 2, r"sdfgrid.* left out \(2 times\)"),
        (BALL.format("") + '<emitter type="volumelight"/>', "volumelight.* not supported as a light"),
        (BALL.format("") + '<integrator type="bdpt"/>', "bdpt.* rendered by path tracing"),
        (
            BALL.format('<bsdf type="conductor"><string name="material" value="Xx"/></bsdf>'),
            "the metal Xx is unknown; rendered as aluminium",
        ),
        (
            BALL.format('<bsdf type="plastic"><float name="specular_reflectance" value="0.5"/></bsdf>') * 2,
            r"^The property specular_reflectance of .*plastic.*\(2 times\)",
        ),
        (BALL.format("") + '<sensor type="perspective"><float name="far_clip" value="0.5"/></sensor>', "its far_clip is ignored"),
        (
            BALL.format('<bsdf type="principled"><float name="sheen" value="1"/></bsdf>'),
            "its sheen is rendered with the sheen model of glTF",
        ),
        (
            BALL.format("") + '<sensor type="perspective"><film type="hdrfilm"><rfilter type="lanczos"/></film></sensor>',
            "lanczos.*tent",
        ),
        (
            BALL.format('<bsdf type="roughplastic"><string name="distribution" value="phong"/></bsdf>') * 2,
            r"its distribution 'phong' is replaced by Beckmann with the same alpha \(2 times\)",
        ),
        (BALL.format('<medium type="gas" name="interior"/>'), r"medium \(gas\) is not supported as a medium: it is left out"),
        (
            BALL.format('<emitter type="directionalarea"/>'),
            r"<emitter type='directionalarea'> in <shape type='sphere'> is ignored",
        ),
        (BALL.format('<bsdf type="twosided"><bsdf type="diffuse"/><bsdf type="plastic"/></bsdf>'), "for each side"),
    ],
)
def test_unsupported_content_is_named(inside: str, sentence: str, tmp_path: Path) -> None:
    import re

    assert any(re.search(sentence, warning) for warning in scene_of(tmp_path, inside).warnings)


@pytest.mark.parametrize(
    ("inside", "sentence"),
    [
        (
            '<sensor type="perspective"><film type="hdrfilm"><float name="gain" value="2"/></film></sensor>',
            "The property gain of <film",
        ),
        ('<sensor type="perspective"><film type="specfilm"/></sensor>', "film (specfilm): is replaced by a film of linear RGB"),
        ('<sensor type="perspective"><film><string name="pixel_format" value="luminance"/></film></sensor>', "pixel_format lum"),
        ('<sensor type="perspective"><sampler type="magic"/></sensor>', "sampler (magic) is unknown"),
        (
            '<sensor type="perspective"><film><rfilter type="box"><float name="radius" value="2"/></rfilter></film></sensor>',
            "of 2 is",
        ),
        (
            '<sensor type="perspective"><float name="aperture_radius" value="2"/></sensor>',
            "The property aperture_radius of <sensor",
        ),
        ('<integrator type="path"/><integrator type="direct"/>', "more than one integrator"),
        ('<float name="gain" value="2"/>', "The property gain of <scene> is ignored"),
        ('<film type="hdrfilm"/>', "<film type='hdrfilm'> in <scene> is ignored"),
        (
            BALL.format('<bsdf type="diffuse"/><bsdf type="conductor"/>'),
            "<bsdf type='conductor'> in <shape type='sphere'> is ignored",
        ),
        (BALL.format('<sensor type="irradiancemeter"/>'), "<sensor type='irradiancemeter'> in <shape type='sphere'> is ignored"),
        (
            BALL.format('<medium name="around" type="homogeneous"/>'),
            "<medium type='homogeneous'> in <shape type='sphere'> is ignored",
        ),
        (BALL.format('<bsdf type="null"><float name="gain" value="2"/></bsdf>'), "The property gain of <bsdf type='null'>"),
        (BALL.format('<bsdf type="mask"><rgb name="opacity" value="1,0,0"/><bsdf type="diffuse"/></bsdf>'), "its opacity is a"),
        (
            BALL.format('<float name="radius" value="1"/><float name="radius" value="2"/>'),
            "radius of shape (sphere) is given more",
        ),
        (BALL.format('<float name="radius" value="1" unit="m" scale="2"/>'), "The attribute scale of <float> is ignored"),
        (BALL.format('<transform name="to_world"><scale value="2" pivot="1"/></transform>'), "The attribute pivot of <scale>"),
        ('<shape type="sphere" hidden="true"/>', "The attribute hidden of <shape> is ignored"),
        ('<shape type="sphere" id="a"/><shape type="sphere" id="a"/>', "has the id of another object"),
    ],
)
def test_unread_properties_are_named(inside: str, sentence: str, tmp_path: Path) -> None:
    assert any(sentence in warning for warning in scene_of(tmp_path, inside + BALL.format("")).warnings)


def test_unused_definitions_cause_no_warning(tmp_path: Path) -> None:
    found = scene_of(tmp_path, '<bsdf type="diffuse" id="spare"><float name="gain" value="2"/></bsdf>' + BALL.format(""))
    assert not any("taken over" in warning for warning in found.warnings)


def test_boolean_values(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="'yes' is neither true nor false"):
        scene_of(tmp_path, BALL.format('<boolean name="flip_normals" value="yes"/>'))


def test_forward_and_renamed_references(tmp_path: Path) -> None:
    found = scene_of(
        tmp_path,
        BALL.format('<ref id="below"/>') + BALL.format('<ref name="x" id="again"/>').replace('"again"', '"below"')
        + '<bsdf type="diffuse" id="below"><rgb name="reflectance" value="0.1,0.2,0.3"/></bsdf><alias id="below" as="other"/>'
        + BALL.format('<ref id="other"/>'),
    )  # fmt: skip
    assert {found.materials[s.material].base_color for s in found.spheres} == {(0.1, 0.2, 0.3)}
    assert not any("is ignored: RGB is rendered" in w for w in found.warnings)


def test_spectrum_plugins(tmp_path: Path) -> None:
    """Spectra given as plugins have the colours of Mitsuba's spectral mode.

    An equal-energy lamp of 1 is grey of luminance 1; a black body of 6500 K is nearly white.
    """
    lamp = '<shape type="rectangle"><emitter type="area"><spectrum type="{}" name="radiance">{}</spectrum></emitter></shape>'
    flat = '<string name="wavelengths" value="300, 900"/><string name="values" value="2, 2"/>'
    warm = '<float name="temperature" value="6500"/>'
    found = scene_of(tmp_path, lamp.format("irregular", flat) + lamp.format("blackbody", warm) + lamp.format("d65", ""))
    even, body, day = (np.array(m.emission) for m in found.materials[-3:])
    assert even @ (0.2126, 0.7152, 0.0722) == pytest.approx(2, rel=0.01)
    assert body / body.mean() == pytest.approx([1, 1, 1], abs=0.06)
    assert body.mean() == pytest.approx(4.3e4, rel=0.1)  # Planck's law at 550 nm, in W / (m2 sr nm)
    assert day.tolist() == [1, 1, 1]
    colors = np.array([spectrum.color for spectrum in found.spectra])  # kept for spectral rendering
    np.testing.assert_allclose(colors, [even / even.max(), body / body.max()], rtol=1e-6)


def test_mask_becomes_opacity(tmp_path: Path, png: Callable[..., bytes]) -> None:
    (tmp_path / "leaf.png").write_bytes(png(255, 255, 255))
    mask = '<bsdf type="mask"><bsdf type="diffuse"/><texture name="opacity" type="bitmap">{}</texture></bsdf>'
    inside = '<string name="filename" value="leaf.png"/><float name="uscale" value="3"/><float name="voffset" value="0.25"/>'
    found = scene_of(tmp_path, BALL.format(mask.format(inside)), "0.6.0")
    material = found.materials[found.meshes[0].material]
    assert material.alpha_mode == "blend"
    assert material.base_color_texture is not None
    texture = found.textures[material.base_color_texture]
    assert found.images[texture.image].pixels[:, 0, 3].tolist() == [255, 0]
    assert texture.transform == (3, 0, 0, 0, 1, 0.25)


@pytest.mark.parametrize(
    ("inside", "sentence"),
    [
        ('<shape type="obj"><string name="filename" value="/etc/passwd"/></shape>', "passwd is not among the files"),
        ('<include filename="../../secret.xml"/>', "includes secret.xml, which is not among"),
        ('<include filename="scene.xml"/>', "include each other"),
        (BALL.format('<ref id="nowhere"/>'), "refers to 'nowhere'"),
        (BALL.format('<float name="radius" value="wide"/>'), "<float name='radius'>: 'wide' is not a list of numbers"),
        (BALL.format('<float name="radius" value="$r"/>'), r"\$r has no value"),
        (BALL.format('<transform name="to_world"><shear x="1"/></transform>'), "shear is not a known step"),
        ("<shape", r"is not valid XML \(invalid token: line 1, column 29\)"),
        ("", "has no surface"),
    ],
)
def test_non_scene_file_is_rejected(inside: str, sentence: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=sentence):
        scene_of(tmp_path, inside)


def test_entities_are_refused(tmp_path: Path) -> None:
    (tmp_path / "scene.xml").write_text('<!DOCTYPE a [<!ENTITY b "c">]><scene version="3.0.0">&b;</scene>')
    with pytest.raises(SceneError, match="XML entities"):
        read(tmp_path, "scene.xml")


def test_damaged_files_are_read_or_rejected(tmp_path: Path) -> None:
    """Files with changed, dropped or doubled characters yield a scene or a SceneError."""
    write_files(tmp_path)
    dice = random.Random(7)
    outcomes = set()
    for text in SHAPES.values():
        for _ in range(60):
            letters = list(text)
            for _ in range(dice.randint(1, 4)):
                at = dice.randrange(len(letters))
                letters[at] = dice.choice(["", letters[at] * 2, dice.choice('0.-"<>/$eE 9'), "nan", "1e400"])
            (tmp_path / "scene.xml").write_text("".join(letters))
            try:
                read(tmp_path, "scene.xml")
                outcomes.add("read")
            except SceneError as error:
                assert "could not be read as" not in str(error), error
                outcomes.add("refused")
    assert outcomes == {"read", "refused"}


def test_analytic_shapes_have_mitsubas_uvs(tmp_path: Path) -> None:
    """Texture coordinates of analytic shapes equal Mitsuba 3.9's at 400 points of each; the first image row is at the bottom."""
    grid = '<bsdf type="diffuse"><texture type="checkerboard" name="reflectance"/></bsdf>'
    names = ("rectangle", "cube", "disk", "cylinder", "sphere")
    found = scene_of(tmp_path, "".join(f'<shape type="{name}">{grid}</shape>' for name in names))
    square, cube, disk, tube, ball = found.meshes
    assert not found.spheres
    x, y, z = square.positions.T
    np.testing.assert_allclose(square.uvs, np.column_stack([(x + 1) / 2, (y + 1) / 2]))
    corner = found.images[0].pixels[0, 0].tolist()  # color0 is at (0, 0)
    assert corner == pytest.approx([0.4] * 3)
    assert square.tangents is not None
    assert square.tangents.tolist() == [[1, 0, 0, 1]] * 4
    upper = cube.positions[:, 2] + (cube.normals[:, 2] > 0.5) * 9 > 9.5  # the face towards +Z: u along +Y and v along +X
    np.testing.assert_allclose(cube.uvs[upper], (cube.positions[upper][:, [1, 0]] + 1) / 2)
    for mesh, v in ((disk, None), (tube, 2), (ball, 2)):
        x, y, z = mesh.positions.astype(float).T
        turn = np.arctan2(y, x) / (2 * np.pi)
        far = np.hypot(x, y) > 0.1
        u = mesh.uvs[:, 0] if v == 2 else mesh.uvs[:, 1]
        assert np.abs(np.sin(np.pi * (u - turn)[far])).max() < 1e-5
        across = np.hypot(x, y) if v is None else z if mesh is tube else np.arccos(np.clip(z, -1, 1)) / np.pi
        np.testing.assert_allclose(mesh.uvs[:, 0 if v is None else 1], across, atol=1e-4)


def test_bubble_becomes_an_inverted_mesh(tmp_path: Path) -> None:
    """Glass whose index is below that of its surroundings becomes an inverted mesh, filled on its outside."""
    glass = '<bsdf type="dielectric"><string name="int_ior" value="air"/><string name="ext_ior" value="water"/></bsdf>'
    found = scene_of(tmp_path, BALL.format(glass) + f'<shape type="cube">{glass}</shape>' + '<shape type="cube"/>')
    assert not found.spheres
    inside_out, cube, plain = found.meshes
    for mesh, sign in ((inside_out, -1), (cube, -1), (plain, 1)):
        corners = mesh.positions[mesh.triangles]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        outwards = np.einsum("ij,ij->i", normals, corners.mean(axis=1))
        assert (np.sign(outwards[np.abs(outwards) > 1e-9]) == sign).all()
    assert found.materials[cube.material].ior == pytest.approx(1.333 / 1.000277)


@pytest.mark.parametrize(("kind", "written"), [("float", "0.5"), ("uchar", "128")])
@pytest.mark.parametrize("is_asked", [True, False])
def test_vertex_colors_are_used_only_if_requested(kind: str, written: str, is_asked: bool, tmp_path: Path) -> None:
    header = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(f"property float {name}\n" for name in "xyz")
    header += "".join(f"property {kind} {name}\n" for name in ("red", "green", "blue"))
    rows = "".join(f"{x} {y} 0 {written} 0 0\n" for x, y in ((0, 0), (1, 0), (0, 1)))
    (tmp_path / "m.ply").write_text(
        f"{header}element face 1\nproperty list uchar int vertex_indices\nend_header\n{rows}3 0 1 2\n"
    )
    texture = '<texture type="mesh_attribute" name="reflectance"><string name="name" value="vertex_color"/></texture>'
    bsdf = f'<bsdf type="twosided"><bsdf type="diffuse">{texture if is_asked else ""}</bsdf></bsdf>'
    found = scene_of(tmp_path, f'<shape type="ply"><string name="filename" value="m.ply"/>{bsdf}</shape>')
    assert not [warning for warning in found.warnings if "light" not in warning]
    (mesh,) = found.meshes
    if not is_asked:
        assert mesh.colors is None and found.materials[mesh.material].base_color == (0.5, 0.5, 0.5)
        return
    assert found.materials[mesh.material].base_color == (1, 1, 1)
    assert mesh.colors is not None
    assert mesh.colors[0, 0] == pytest.approx(0.5 if kind == "float" else 0.2159, abs=3e-3)


def test_images_are_decoded_unless_raw(tmp_path: Path, png: Callable[..., bytes]) -> None:
    """As in Mitsuba, images are decoded unless raw, also where they hold data; a textured roughness stays a texture."""
    (tmp_path / "g.png").write_bytes(png(128, 128, 128))
    texture = '<texture name="roughness" type="bitmap"><string name="filename" value="g.png"/>{}</texture>'
    for more, level in (("", 55), ('<boolean name="raw" value="true"/>', 128)):
        found = scene_of(tmp_path, BALL.format(f'<bsdf type="principled">{texture.format(more)}</bsdf>'))
        material = found.materials[found.meshes[0].material]
        assert material.roughness == 1
        assert material.metallic_roughness_texture is not None
        pixels = found.images[found.textures[material.metallic_roughness_texture].image].pixels
        assert pixels[0, 0, 1] == pytest.approx(level, abs=1)
        assert any("is decoded as a colour" in warning for warning in found.warnings) == (not more)


@pytest.mark.parametrize("named", ["", '<string name="distribution" value="ggx"/>'])
@pytest.mark.parametrize(
    ("plugin", "kind"), [("roughplastic", "plastic"), ("roughdielectric", "glass"), ("roughconductor", "metallic_roughness")]
)
def test_microfacet_distribution_is_read(tmp_path: Path, plugin: str, kind: str, named: str) -> None:
    """Microfacets have the file's distribution, by default Beckmann's, without a warning."""
    ball = BALL.format(f'<bsdf type="{plugin}"><float name="alpha" value="0.25"/>{named}</bsdf>')
    found = scene_of(tmp_path, ball + '<emitter type="constant"/>')
    material = next(m for m in found.materials if m.kind == kind)
    assert material.distribution == ("ggx" if named else "beckmann")
    assert material.roughness == pytest.approx(0.5)
    assert not found.warnings


def test_crop_window_is_rendered(tmp_path: Path) -> None:
    """A crop window of the film shows the same part of the view as the whole film does there."""
    film = '<film type="hdrfilm"><integer name="width" value="200"/><integer name="height" value="100"/>{}</film>'
    window = "".join(
        f'<integer name="crop_{key}" value="{value}"/>'
        for key, value in (("offset_x", 120), ("offset_y", 10), ("width", 40), ("height", 20))
    )
    lens = '<float name="fov" value="60"/><float name="principal_point_offset_x" value="0.1"/>'
    found = scene_of(tmp_path, f'<sensor type="perspective">{lens}{film.format(window)}</sensor>' + BALL.format(""))
    assert (found.defaults["width"], found.defaults["height"]) == (40, 20)
    view = found.cameras[0].view
    scale = np.tan(np.radians(30)) * 2 / 200  # a pixel's size at distance 1
    assert 2 * np.tan(np.radians(view.fov / 2)) == pytest.approx(20 * scale)
    assert view.shift_x * 20 == pytest.approx(0.1 * 200 + 140 - 100)
    assert view.shift_y * 20 == pytest.approx(50 - 20)
    with pytest.raises(SceneError, match="outside of its 200x100 pixels"):
        scene_of(tmp_path, f'<sensor type="perspective">{film.format(window.replace("120", "170"))}</sensor>')


@pytest.mark.parametrize(
    ("lens", "axis", "half"),
    [
        ("", "diagonal", np.hypot(36, 24) / 100),
        ('<string name="focal_length" value="35mm"/>', "diagonal", np.hypot(36, 24) / 70),
        ('<float name="fov" value="40"/>', "x", np.tan(np.radians(20))),
        ('<float name="fov" value="40"/><string name="fov_axis" value="diagonal"/>', "diagonal", np.tan(np.radians(20))),
        ('<float name="fov" value="40"/><string name="fov_axis" value="smaller"/>', "smaller", np.tan(np.radians(20))),
        ('<float name="fov" value="40"/><string name="fov_axis" value="larger"/>', "larger", np.tan(np.radians(20))),
    ],
)
@pytest.mark.parametrize(("width", "height"), [(100, 100), (200, 100), (100, 200)])
@pytest.mark.parametrize("kind", ["perspective", "thinlens"])
def test_default_lens_is_50_mm(tmp_path: Path, lens: str, axis: str, half: float, width: int, height: int, kind: str) -> None:
    """Without a field of view the lens has 50 mm on film of 36 x 24 mm, by the diagonal: 34.0 degrees for a square picture."""
    film = f'<film type="hdrfilm"><integer name="width" value="{width}"/><integer name="height" value="{height}"/></film>'
    found = scene_of(tmp_path, f'<sensor type="{kind}">{lens}{film}</sensor>' + BALL.format(""))
    sides = {"x": width, "diagonal": np.hypot(width, height), "smaller": min(width, height), "larger": max(width, height)}
    assert np.tan(np.radians(found.cameras[0].view.fov / 2)) == pytest.approx(half * height / sides[axis])


def test_invalid_focal_length_is_an_error_message(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="focal_length is 'wide'; write it in millimetres"):
        scene_of(tmp_path, '<sensor type="perspective"><string name="focal_length" value="wide"/></sensor>' + BALL.format(""))


@pytest.mark.parametrize("owner", ["vertex", "face"])
def test_float_ply_colors_are_linear(tmp_path: Path, owner: str) -> None:
    """Float colours of PLY files, with the names of Mitsuba's writer, are read as linear and not rounded."""
    color = np.array([0.2137, 0.001, 0.7713], np.float32)
    columns = {
        each: "".join(f"property float color_{k}\n" for k in range(3)) if each == owner else "" for each in ("vertex", "face")
    }
    header = (
        "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        f"{columns['vertex']}element face 1\nproperty list uchar int vertex_indices\n{columns['face']}end_header\n"
    )
    written = {each: " " + " ".join(map(str, color)) if each == owner else "" for each in ("vertex", "face")}
    rows = "".join(f"{corner}{written['vertex']}\n" for corner in ("0 0 0", "1 0 0", "0 1 0")) + f"3 0 1 2{written['face']}\n"
    (tmp_path / "m.ply").write_text(header + rows)
    texture = f'<texture type="mesh_attribute" name="reflectance"><string name="name" value="{owner}_color"/></texture>'
    shape = f'<shape type="ply"><string name="filename" value="m.ply"/><bsdf type="diffuse">{texture}</bsdf></shape>'
    mesh = scene_of(tmp_path, shape).meshes[0]
    assert mesh.colors is not None
    np.testing.assert_allclose(mesh.colors, np.tile([*color, 1], (3, 1)), rtol=1e-6)


@pytest.mark.parametrize("distribution", ["", '<string name="distribution" value="ggx"/>'])
def test_blend_of_diffuse_and_rough_metal_keeps_the_distribution(tmp_path: Path, distribution: str) -> None:
    metal = f'<bsdf type="roughconductor">{distribution}<string name="material" value="Au"/></bsdf>'
    blend = f'<bsdf type="blendbsdf"><float name="weight" value="0.4"/><bsdf type="diffuse"/>{metal}</bsdf>'
    found = scene_of(tmp_path, f'<shape type="rectangle">{blend}</shape>')
    assert not [warning for warning in found.warnings if "light" not in warning]
    made = found.materials[found.meshes[0].material]
    assert (made.kind, made.specular) == ("metallic_roughness", 0.4)
    assert made.distribution == ("ggx" if distribution else "beckmann")


_ATTRIBUTES = {  # attribute in Mitsuba 3.9 -> the PLY columns that contain it, with their element
    "vertex_heat": (("vertex", "heat_0"),),
    "vertex_warm": (("vertex", "warm_x"), ("vertex", "warm_y"), ("vertex", "warm_z")),
    "face_label": (("face", "label_1"), ("face", "label_2"), ("face", "label_3")),
    "face_paint_color": (("face", "paint_r"), ("face", "paint_g"), ("face", "paint_b")),
    "face_color": (("face", "red"), ("face", "green"), ("face", "blue")),
}


def with_attribute(folder: Path, columns: tuple[tuple[str, str], ...], asked: str, values: tuple[float, ...]) -> SceneDescription:
    """Returns a scene of a triangle with vertex colours and further PLY columns, whose material uses the attribute `asked`."""
    told = {each: [name for owner, name in columns if owner == each] for each in ("vertex", "face")}
    header = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(f"property float {name}\n" for name in "xyz")
    header += "".join(f"property float {name}\n" for name in ("color_0", "color_1", "color_2", *told["vertex"]))
    header += "element face 1\nproperty list uchar int vertex_indices\n"
    header += "".join(f"property float {name}\n" for name in told["face"]) + "end_header\n"
    own = {each: " ".join(map(str, values[: len(names)])) for each, names in told.items()}
    rows = (
        "".join(f"{corner} 0.9 0.8 0.7 {own['vertex']}\n" for corner in ("0 0 0", "1 0 0", "0 1 0")) + f"3 0 1 2 {own['face']}\n"
    )
    (folder / "m.ply").write_text(header + rows)
    texture = f'<texture type="mesh_attribute" name="reflectance"><string name="name" value="{asked}"/></texture>'
    bsdf = f'<bsdf type="twosided"><bsdf type="diffuse">{texture}</bsdf></bsdf>'
    return scene_of(folder, f'<shape type="ply"><string name="filename" value="m.ply"/>{bsdf}</shape>')


@pytest.mark.parametrize("attribute", _ATTRIBUTES)
def test_mesh_attributes_as_colors(tmp_path: Path, attribute: str) -> None:
    columns, values = _ATTRIBUTES[attribute], (0.25, 0.5, 0.125)
    found = with_attribute(tmp_path, columns, attribute, values)
    assert not [warning for warning in found.warnings if "light" not in warning]
    expected = values if len(columns) == 3 else values[:1] * 3
    assert found.meshes[0].colors is not None
    np.testing.assert_allclose(found.meshes[0].colors, np.tile([*expected, 1], (3, 1)), atol=1e-6)


def test_missing_or_invalid_attribute_causes_a_warning(tmp_path: Path) -> None:
    found = with_attribute(tmp_path, _ATTRIBUTES["vertex_heat"], "vertex_cold", (0.5,))
    assert found.meshes[0].colors is None
    assert "no attribute vertex_cold" in " ".join(found.warnings)
    found = with_attribute(tmp_path, _ATTRIBUTES["vertex_heat"], "vertex_heat", (7.0,))
    assert "3 values of vertex_heat are outside of 0 to 1 and clamped" in " ".join(found.warnings)
    found = with_attribute(tmp_path, (*_ATTRIBUTES["vertex_heat"], ("vertex", "heat_1")), "vertex_heat", (0.5, 0.5))
    assert "no attribute vertex_heat" in " ".join(found.warnings), "two channels are none"


@pytest.mark.parametrize("flipped", [False, True])
def test_light_emits_along_vertex_normals(tmp_path: Path, flipped: bool) -> None:
    """A light emits along its vertex normals, here -Z, not along its winding, here +Z."""
    corners = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvn 0 0 -1\n"
    (tmp_path / "o.obj").write_text(corners + "f 1//1 2//1 3//1\nf 1//1 3//1 4//1\n")
    more = f'<boolean name="flip_normals" value="{str(flipped).lower()}"/>'
    light = '<emitter type="area"><rgb name="radiance" value="1"/></emitter>'
    found = scene_of(tmp_path, f'<shape type="obj"><string name="filename" value="o.obj"/>{more}{light}</shape>')
    mesh = found.meshes[0]
    a, b, c = (mesh.positions[mesh.triangles[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0).all() == flipped


@pytest.mark.parametrize("shape", ["rectangle", "cube", "disk", "sphere", "cylinder"])
def test_bump_map_tilts_away_from_rising_heights(tmp_path: Path, shape: str) -> None:
    """A bump map tilts the normal away from rising heights: heights linear in v subtract a multiple of dp/dv everywhere."""
    ramp = np.repeat(np.linspace(0, 1, 64, dtype=np.float32)[:, None, None], 64, axis=1)
    write(tmp_path / "ramp.exr", np.repeat(ramp, 3, axis=2))
    texture = '<texture type="bitmap"><string name="filename" value="ramp.exr"/><boolean name="raw" value="true"/></texture>'
    found = scene_of(tmp_path, f'<shape type="{shape}"><bsdf type="bumpmap">{texture}<bsdf type="diffuse"/></bsdf></shape>')
    mesh = found.meshes[found.instances[0].mesh]
    assert mesh.uvs is not None and mesh.normals is not None
    tangents = vertex_tangents(mesh.positions, mesh.normals, mesh.uvs, mesh.triangles) if mesh.tangents is None else mesh.tangents
    image = found.images[found.textures[found.materials[mesh.material].normal_texture or 0].image]
    green = 2.0 * image.pixels[32, 32, 1] / np.iinfo(image.pixels.dtype).max - 1
    corner = mesh.triangles[len(mesh.triangles) // 2]
    p, uv = mesh.positions[corner].astype(float), mesh.uvs[corner].astype(float)
    along = np.linalg.lstsq(uv[1:] - uv[0], p[1:] - p[0], rcond=None)[0]  # dp/du, dp/dv
    normal = mesh.normals[corner[0]]
    across = np.cross(normal, tangents[corner[0], :3]) * tangents[corner[0], 3]
    assert green * float(across @ along[1]) < 0


def test_curves_become_tubes_of_the_files_radius(tmp_path: Path) -> None:
    (tmp_path / "hair.txt").write_text(
        "0 0 0 0.1\n1 0 0 0.1\n2 0 0 0.1\n3 0 0 0.1\n\n0 1 0 0.2\n1 1 0 0.2\n2 1 0 0.2\n3 1 0 0.2\n"
    )
    place = '<transform name="to_world"><scale value="2"/></transform>'
    for kind, ends in (("linearcurve", (0, 6)), ("bsplinecurve", (2, 4))):
        found = scene_of(tmp_path, f'<shape type="{kind}"><string name="filename" value="hair.txt"/>{place}</shape>')
        points = found.meshes[0].positions
        assert points[:, 0].min() == pytest.approx(ends[0], abs=1e-6) and points[:, 0].max() == pytest.approx(ends[1], abs=1e-6)
        assert points[:, 1].min() == pytest.approx(-0.1, abs=0.01) and points[:, 1].max() == pytest.approx(2.2, abs=0.02)
    (tmp_path / "hair.txt").write_text("0 0 0\n")
    with pytest.raises(SceneError, match="line 1: a point of a curve needs four numbers"):
        scene_of(tmp_path, '<shape type="linearcurve"><string name="filename" value="hair.txt"/></shape>')


def test_environment_map_rotation(tmp_path: Path) -> None:
    """An environment map of a file with +Z up keeps its bright part above after rotation, and its total light."""
    import OpenImageIO as oiio  # noqa: N813 -- the name its own documentation uses

    sky = np.full((16, 32, 3), 0.1, np.float32)
    sky[:2] = 5  # the bright top rows
    made = oiio.ImageOutput.create(str(tmp_path / "sky.exr"))
    made.open(str(tmp_path / "sky.exr"), oiio.ImageSpec(32, 16, 3, "float"))
    made.write_image(sky)
    made.close()
    place = '<transform name="to_world"><rotate x="1" angle="90"/></transform>'
    found = scene_of(
        tmp_path, f'<emitter type="envmap"><string name="filename" value="sky.exr"/>{place}</emitter>' + BALL.format("")
    )
    assert found.environment is not None and found.environment.image is not None
    seen = found.images[found.environment.image].pixels
    # +Y is rotated to +Z, which is behind the view of our image centre, -Z: at the left and right edge, half way up.
    assert seen[7:9, [0, -1]].mean() == pytest.approx(5)
    assert seen[0].max() == pytest.approx(0.1) and seen[7:9, 15:17].max() == pytest.approx(0.1)
    weight = np.sin((np.arange(16) + 0.5) / 16 * np.pi)[:, None, None]
    assert (seen * weight).mean() == pytest.approx(float((sky * weight).mean()), rel=0.03)


UPRIGHT = '<transform name="to_world"><rotate x="1" angle="-90"/></transform>'


@pytest.mark.long
@pytest.mark.parametrize("place, up", [(UPRIGHT, (0, 1, 0)), ("", (0, 0, 1))])
def test_sky_and_sun_brightness_match_mitsuba(tmp_path: Path, place: str, up: tuple[int, int, int]) -> None:
    """Irradiance on a horizontal plane from the sky, and from a sun at 60 degrees elevation, equals Mitsuba 3.9's.

    The up vector of the sky emitter is +Z by default. The sky is black below the horizon.
    """
    sun = np.array((0.5, 0, 0)) + 0.75**0.5 * np.array(up)
    where = f'<vector name="sun_direction" x="{sun[0]}" y="{sun[1]}" z="{sun[2]}"/>'
    found = scene_of(tmp_path, f'<emitter type="sunsky">{where}{place}</emitter>' + BALL.format(""))
    assert found.environment is not None and found.environment.image is not None
    pixels = found.images[found.environment.image].pixels.astype(float)
    height = len(pixels)
    theta, phi = (np.arange(height) + 0.5) * np.pi / height, (np.arange(2 * height) + 0.5) * np.pi / height - np.pi
    x, y = np.sin(theta)[:, None] * np.sin(phi), np.broadcast_to(np.cos(theta)[:, None], (height, 2 * height))
    directions = np.stack([x, y, -np.sin(theta)[:, None] * np.cos(phi)], axis=-1)
    weight = (np.maximum(directions @ up, 0) * np.sin(theta)[:, None] * (np.pi / height) ** 2)[..., None]
    got = (pixels * weight).sum((0, 1)) * found.environment.color
    np.testing.assert_allclose(got, (0.1683, 0.2676, 0.4646), rtol=0.1)
    assert pixels[directions @ up < -0.02].max() == 0
    towards_sun = pixels[directions @ sun > 0.98].mean()
    assert (
        towards_sun > 2 * pixels[(directions @ (sun * (-1, 1, 1)) if up[1] else directions @ (-0.5, 0, 0.75**0.5)) > 0.98].mean()
    )
    [light] = found.lights
    np.testing.assert_allclose(light.direction, -sun, atol=1e-9)
    np.testing.assert_allclose(np.multiply(light.intensity, 0.75**0.5), (1.298, 1.087, 0.837), rtol=0.03)
    assert (light.angle, light.seen) == (pytest.approx(0.5358), "always")


@pytest.mark.long
def test_sky_or_sun_may_be_off(tmp_path: Path) -> None:
    sun = '<vector name="sun_direction" x="0" y="1" z="1"/>'
    sky = scene_of(tmp_path, f'<emitter type="sunsky">{sun}<float name="sun_scale" value="0"/></emitter>' + BALL.format(""))
    assert (sky.environment is not None, sky.lights) == (True, [])
    alone = scene_of(tmp_path, f'<emitter type="sunsky">{sun}<float name="sky_scale" value="0"/></emitter>' + BALL.format(""))
    assert (alone.environment, len(alone.lights)) == (None, 1)


def test_constant_spectrum_as_light_and_as_reflectance(tmp_path: Path) -> None:
    lamp = '<shape type="rectangle"><bsdf type="diffuse"><spectrum name="reflectance" value="0.3"/></bsdf>{}</shape>'
    light = '<emitter type="area"><spectrum name="radiance" value="2"/></emitter>'
    material = scene_of(tmp_path, lamp.format(light)).materials[0]
    assert material.base_color == (0.3, 0.3, 0.3)
    assert material.emission == pytest.approx((2.41, 1.90, 1.82), rel=0.01)  # as in Mitsuba's RGB mode
    old = scene_of(tmp_path, lamp.format(light), "0.6.0").materials[0]
    assert old.emission == (2, 2, 2)
