"""Tests of Mitsuba's media and bump maps: coefficients and slopes by their formulas. tests/peers compares pictures."""

from __future__ import annotations

import math
import re
import struct
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from renderer.scene.description import Material, Medium, SceneDescription
from tests.renderer.scene.test_mitsuba import BALL, scene_of

SMOKE = (
    '<medium type="homogeneous" id="smoke"><rgb name="albedo" value="0.5 0.8 0.25"/><rgb name="sigma_t" value="2 1 4"/>'
    '<float name="scale" value="3"/><phase type="hg"><float name="g" value="-0.4"/></phase></medium>'
)
HELD = Medium((3.0, 0.6, 9.0), (3.0, 2.4, 3.0), -0.4)
GLASS, NULL = '<bsdf type="dielectric"/>', '<bsdf type="null"/>'


def within(name: str = "interior") -> str:
    return f'<ref id="smoke" name="{name}"/>'


def of(found: SceneDescription, number: int = 0) -> tuple[Material, Medium]:
    made = found.materials[found.spheres[number].material]
    return made, Medium(made.sigma_a, made.sigma_s, made.g)


def close(first: Medium, second: Medium) -> bool:
    return np.allclose((*first.sigma_a, *first.sigma_s, first.g), (*second.sigma_a, *second.sigma_s, second.g))


def named(found: SceneDescription, sentence: str) -> bool:
    return any(re.search(sentence, warning) for warning in found.warnings)


@pytest.mark.parametrize(("bsdf", "kind"), [(GLASS, "glass"), ('<bsdf type="roughdielectric"/>', "glass"), (NULL, "interface")])
def test_medium_fills_glass_and_interfaces(tmp_path: Path, bsdf: str, kind: str) -> None:
    found = scene_of(tmp_path, SMOKE + BALL.format(bsdf + within()) + BALL.format('<bsdf type="diffuse"/>' + within()))
    made, medium = of(found)
    assert made.kind == kind
    assert close(medium, HELD)
    assert of(found, 1)[1] == Medium()
    assert found.medium is None
    assert not named(found, "medium|not taken over")


def test_each_medium_makes_its_own_material(tmp_path: Path) -> None:
    glass = '<ref id="g"/>'
    shared = BALL.format(glass + within()) + BALL.format(glass)
    found = scene_of(tmp_path, SMOKE + '<bsdf type="dielectric" id="g"/>' + shared)
    assert close(of(found)[1], HELD)
    assert of(found, 1)[1] == Medium()
    assert named(found, "Glass without a medium is clear inside; in Mitsuba the surrounding medium continues")


@pytest.mark.parametrize(
    ("inside", "expected"),
    [
        ("", Medium((0.25,) * 3, (0.75,) * 3)),
        ('<phase type="hg"/>', Medium((0.25,) * 3, (0.75,) * 3, 0.8)),
        ('<phase type="isotropic"/><float name="sigma_t" value="2"/>', Medium((0.5,) * 3, (1.5,) * 3)),
        (
            '<volume type="constvolume" name="albedo"><rgb name="value" value="0 0.5 1"/></volume>',
            Medium((1, 0.5, 0), (0, 0.5, 1)),
        ),
        ('<rgb name="sigma_a" value="1 2 3"/><rgb name="sigma_s" value="4 5 6"/>', Medium((1, 2, 3), (4, 5, 6))),
    ],
)
def test_medium_notations(tmp_path: Path, inside: str, expected: Medium) -> None:
    filled = f'<medium type="homogeneous" name="interior">{inside}</medium>'
    found = scene_of(tmp_path, BALL.format(NULL + filled))
    assert close(of(found)[1], expected)
    assert not named(found, "medium|not taken over")


def test_substances_of_mitsuba_0_6(tmp_path: Path) -> None:
    skin = '<medium type="homogeneous" name="interior"/>'
    filled = skin[:-2] + '><string name="material" value="skimmilk"/><float name="scale" value="2"/></medium>'
    found = scene_of(tmp_path, BALL.format(NULL + filled) + BALL.format(NULL + skin), "0.6.0")
    assert close(of(found)[1], Medium((0.0028, 0.005, 0.0284), (1.4, 2.44, 3.8)))
    assert close(of(found, 1)[1], Medium((0.032, 0.17, 0.48), (0.74, 0.88, 1.01)))


def test_bubble_is_filled_with_the_exterior_medium(tmp_path: Path) -> None:
    bubble = '<bsdf type="dielectric"><string name="int_ior" value="air"/><string name="ext_ior" value="water"/></bsdf>'
    found = scene_of(tmp_path, SMOKE + BALL.format(bubble + within("exterior")))
    (made,) = found.materials
    assert close(Medium(made.sigma_a, made.sigma_s, made.g), HELD)
    assert found.instances  # an inverted mesh


@pytest.mark.parametrize(("radius", "is_world"), [(0.5, True), (9, False)])
def test_sensor_medium_fills_the_world_unless_inside_a_shape(tmp_path: Path, radius: float, is_world: bool) -> None:
    sensor = '<sensor type="perspective"><ref id="smoke"/><transform name="to_world"><translate z="3"/></transform></sensor>'
    found = scene_of(tmp_path, SMOKE + sensor + BALL.format(f'<float name="radius" value="{radius}"/>{NULL}{within()}'))
    assert found.medium is None if not is_world else close(found.medium or Medium(), HELD)


@pytest.mark.parametrize(
    ("inside", "sentence"),
    [
        (
            BALL.format(NULL + '<medium type="homogeneous" name="interior"><volume name="albedo" type="gridvolume"/></medium>'),
            "albedo varies in space, which is not supported: the medium is left out",
        ),
        (
            BALL.format(NULL + '<medium type="heterogeneous" name="interior"><phase type="sggx"/></medium>'),
            "sggx.* not supported as a phase function",
        ),
        (SMOKE + BALL.format('<bsdf type="thindielectric"/>' + within()), "its medium is ignored, since its material is thin"),
        (
            SMOKE + BALL.format(f'<bsdf type="mask">{GLASS}</bsdf>' + within()).replace("dielectric", "diffuse"),
            "its medium is ignored, since its material has holes",
        ),
        (SMOKE + BALL.format(GLASS + within("exterior")), "The medium around shape .sphere. is ignored"),
        (
            BALL.format(NULL + '<subsurface type="dipole"/>'),
            "its subsurface scattering is not supported",
        ),
    ],
)
def test_unsupported_content_is_named(tmp_path: Path, inside: str, sentence: str) -> None:
    assert named(scene_of(tmp_path, inside, "0.6.0" if "dipole" in inside else "3.0.0"), sentence)


def test_area_light_on_interface_is_a_lamp_without_a_body(tmp_path: Path) -> None:
    found = scene_of(tmp_path, SMOKE + BALL.format(NULL + '<emitter type="area"/>' + within()))
    made, medium = of(found)
    assert (made.kind, made.lamp, medium) == ("diffuse", True, Medium())
    assert min(made.emission) > 0


def test_hair(tmp_path: Path) -> None:
    """Hair keeps its pigments or its absorption, its roughnesses and its tilt; its fibres are curves with tangents."""
    made = of(scene_of(tmp_path, BALL.format('<bsdf type="hair"/>')))[0]
    assert (made.kind, made.eumelanin, made.pheomelanin, made.beta_m, made.beta_n) == ("hair", 1.3, 0.2, 0.3, 0.3)
    assert made.ior == pytest.approx(1.55 / 1.000277) and math.degrees(made.tilt) == pytest.approx(2)
    said = '<rgb name="sigma_a" value="0.1 0.2 0.4"/><float name="scale" value="3"/><float name="scale_tilt" value="3"/>'
    (tmp_path / "hair.txt").write_text("0 0 0 0.1\n1 0 0 0.1\n2 0 0 0.1\n3 0 0 0.1\n")
    curve = f'<shape type="linearcurve"><string name="filename" value="hair.txt"/><bsdf type="hair">{said}</bsdf></shape>'
    found = scene_of(tmp_path, curve)
    mesh = found.meshes[found.instances[0].mesh]
    np.testing.assert_allclose(found.materials[mesh.material].sigma_a, (0.3, 0.6, 1.2))
    assert mesh.tangents is not None and mesh.diameters is not None
    np.testing.assert_allclose(mesh.tangents, [(1, 0, 0, 1)] * len(mesh.positions))
    np.testing.assert_allclose(mesh.diameters, 0.2)
    assert mesh.triangles.tolist() == [[0, 1, 1], [1, 2, 2], [2, 3, 3]]


def test_bump_map_slopes(tmp_path: Path) -> None:
    """A bump map on a square 2 wide becomes slopes of its heights, which rise by 2 / 255 per texel of 1/64 of its width.

    The slopes are multiplied by the map's scale.
    """
    row = np.minimum(np.arange(64) * 2, 255).astype(np.uint8)
    Image.fromarray(np.tile(row, (8, 1))).save(tmp_path / "h.png")
    bumps = (
        '<bsdf type="bumpmap"><texture type="bitmap"><string name="filename" value="h.png"/><boolean name="raw" value="true"/>'
        '<string name="wrap_mode" value="clamp"/></texture><float name="scale" value="0.5"/><bsdf type="diffuse"/></bsdf>'
    )
    found = scene_of(tmp_path, f'<shape type="rectangle"><bsdf type="twosided">{bumps}</bsdf></shape>' + BALL.format(bumps))
    made = found.materials[found.meshes[found.instances[0].mesh].material]
    texture = found.textures[made.normal_texture or 0]
    pixels = found.images[texture.image].pixels[4, 20, :3] / 127.5 - 1
    assert pixels[0] / pixels[2] * made.normal_scale == pytest.approx(-0.5 * 2 / 255 * 64 / 2, rel=0.02)
    assert found.materials[found.meshes[found.instances[1].mesh].material].normal_scale < made.normal_scale
    assert not named(found, "bumpmap|scale")


GRID = np.arange(24, dtype=np.float32).reshape(4, 3, 2)
HETEROGENEOUS = """<medium type="heterogeneous" name="interior"><volume type="gridvolume" name="sigma_t">
<string name="filename" value="grid.vol"/><boolean name="use_grid_bbox" value="true"/>
<transform name="to_world"><translate y="1"/></transform></volume>
<rgb name="albedo" value="0.5 0.8 0.25"/><float name="scale" value="3"/></medium>"""


def test_a_gridvolume_is_the_density_of_its_medium(tmp_path: Path) -> None:
    header = b"VOL\x03" + struct.pack("<5i6f", 1, 2, 3, 4, 1, -1, -2, -3, 1, 2, 3)
    (tmp_path / "grid.vol").write_bytes(header + GRID.tobytes())
    found = scene_of(tmp_path, BALL.format(NULL + HETEROGENEOUS))
    assert not named(found, "medium|volume|property")
    made, held = of(found)
    assert close(held, Medium((1.5, 0.6, 2.25), (1.5, 2.4, 0.75)))
    volume = found.volumes[made.volume]
    np.testing.assert_array_equal(volume.density, GRID)
    np.testing.assert_allclose(volume.to_world, [[2, 0, 0, -1], [0, 4, 0, -1], [0, 0, 6, -3], [0, 0, 0, 1]])


def test_a_gridvolume_whose_file_is_missing_is_named(tmp_path: Path) -> None:
    found = scene_of(tmp_path, BALL.format(NULL + HETEROGENEOUS))
    assert named(found, r"grid\.vol is not among the files")
    assert not found.volumes
