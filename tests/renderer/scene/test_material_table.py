"""Tests of the table of material parameters, the single source for checks, packing, schema and readers."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from renderer.arrays import rows
from renderer.errors import SceneError
from renderer.scene.description import Image, SceneDescription, Texture
from renderer.scene.material import PARAMETERS, Material
from renderer.scene.material_packing import pack
from tests.renderer.scene.builders import Gltf

COUNT = {"color": 3, "radiance": 3, "triple": 3, "pair": 2}
NUMBERS = [p for p in PARAMETERS if p.form not in ("choice", "texture", "flag", "name")]
IN_GLTF = [p for p in PARAMETERS if p.gltf]


def other(parameter):
    """Returns a valid value of the parameter that is not its default and is exact in float32."""
    default = np.ravel(1.0 if parameter.default is None else parameter.default)[0]
    low, high = max(parameter.low, default - 0.5), min(parameter.high, default + 0.5)
    value = high if high != default and math.isfinite(high) else low
    return 2.0 if math.isinf(value) else float(value)


def row(material):
    """Compiles a scene of one material; returns the material's row of packed columns, and its row of texture slots."""
    images = [Image("i", np.full((1, 1, 4), 9, np.uint8))]
    packed = pack(SceneDescription(materials=[material], textures=[Texture(0)], images=images))
    return packed.material[0], packed.material_texture[0]


def test_no_two_parameters_share_a_column_or_a_slot():
    columns = [p.column + i for p in PARAMETERS if p.column is not None for i in range(COUNT.get(p.form, 1))]
    made = [
        rows.ROUGHNESS,
        rows.ROTATION,
        rows.ROTATION + 1,
    ]  # columns that packing derives from several parameters, or from None
    made += [c + i for c in (rows.EMISSION, rows.ABSORPTION, rows.F0, rows.MEAN_FRESNEL) for i in range(3)]
    made += range(rows.HAIR_VARIANCE, rows.HAIR_COLOR_SCALE + 1)
    assert sorted(columns + made) == list(range(rows.COLUMNS))
    slots = [p.slot for p in PARAMETERS if p.slot is not None]
    assert sorted([*slots, rows.EMISSION_TEXTURE]) == list(
        range(rows.SLOTS)
    )  # emission texels have a scale, so this slot is filled separately


@pytest.mark.parametrize("parameter", NUMBERS, ids=lambda p: p.name)
def test_scene_file_parameter_reaches_its_column(scene, parameter):
    value = other(parameter)
    written = [value] * COUNT[parameter.form] if parameter.form in COUNT else value
    needs = {"blinn_phong": {"specular_color": 0}, "conductor": {"eta": 1, "k": 1}}.get(parameter.kinds[0], {})
    material = {"kind": parameter.kinds[0], **needs, parameter.in_file: written}
    text = json.dumps({"materials": {"m": material}, "shapes": [{"type": "quad", "material": "m"}]})
    read = scene("s.yaml", text).materials[0]
    expected = math.radians(value) if parameter.form == "degrees" else value
    assert np.ravel(getattr(read, parameter.name)) == pytest.approx(expected)
    if parameter.column is not None and parameter.kinds[0] not in (
        "glass",
        "blinn_phong",
    ):  # these kinds fill the columns differently
        packed = row(read)[0][parameter.column : parameter.column + COUNT.get(parameter.form, 1)]
        assert packed == pytest.approx(np.full(len(packed), expected))


@pytest.mark.parametrize("parameter", [p for p in PARAMETERS if p.form == "texture"], ids=lambda p: p.name)
def test_scene_file_texture_reaches_its_slot(scene, png, parameter):
    material = {"kind": parameter.kinds[-1], "emission": 1, parameter.in_file: "t"}
    document = {
        "materials": {"m": material},
        "textures": {"t": {"image": "t.png"}},
        "shapes": [{"type": "quad", "material": "m"}],
    }
    description = scene("s.yaml", json.dumps(document), {"t.png": png(10, 20, 30)})
    assert getattr(description.materials[0], parameter.name) == 0
    assert description.images[0].srgb == parameter.srgb
    slots = pack(description).material_texture[0]
    filled = {"emission_texture": [rows.EMISSION_TEXTURE], "displacement_texture": []}.get(parameter.name, [parameter.slot])
    assert list(np.flatnonzero(slots >= 0)) == filled


@pytest.mark.parametrize("parameter", IN_GLTF, ids=lambda p: p.name)
def test_gltf_parameter_is_read(scene, png, parameter):
    *way, key = parameter.gltf.split(".")
    g = Gltf()
    expected = value = other(parameter) if parameter.form not in ("texture", "flag") else True
    if parameter.form == "texture":
        expected, value = 0, {"index": g.texture({"bufferView": g.view(png(1, 2, 3)), "mimeType": "image/png"})}
    elif parameter.form in COUNT:
        value = [value] * COUNT[parameter.form]
    source = {key: value}
    for step in reversed(way):
        source = {step: source}
        if step.startswith(("KHR_", "RAYFARM_")):
            source = {"extensions": source}
        elif step.endswith("Texture"):
            source[step]["index"] = g.texture({"bufferView": g.view(png(1, 2, 3)), "mimeType": "image/png"})
    g.mesh(material=g.material(**source))
    read = scene("a.glb", g.glb()).materials[0]
    assert np.ravel(getattr(read, parameter.name)) == pytest.approx(expected)


@pytest.mark.parametrize("parameter", [p for p in PARAMETERS if p.mtl], ids=lambda p: p.name)
def test_mtl_parameter_is_read(scene, parameter):
    obj = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n"
    read = scene("a.obj", obj, {"m.mtl": f"newmtl m\nPr 0.3\n{parameter.mtl} {other(parameter)}\n"}).materials[0]
    assert getattr(read, parameter.name) == pytest.approx(other(parameter))


@pytest.mark.parametrize("parameter", NUMBERS, ids=lambda p: p.name)
def test_packing_rejects_invalid_parameters(parameter):
    for wrong in (math.nan, parameter.low - 1, parameter.high + 1):
        if math.isinf(wrong):
            continue
        value = (wrong,) * COUNT[parameter.form] if parameter.form in COUNT else wrong
        with pytest.raises(SceneError, match=f"Material odd: its {parameter.in_file} is .*; it must be"):
            row(Material("odd", "metallic_roughness", **{parameter.name: value}))


def test_packing_rejects_other_faults():
    for fields, sentence in (
        ({"kind": "velvet"}, "its kind is 'velvet'; known are diffuse, mirror"),
        ({"double_sided": 1}, "its double_sided is 1; it must be true or false"),
        ({"sheen_color": (0.1, 0.2)}, "its sheen_color has 2 numbers; it needs 3"),
        ({"attenuation_distance": 0.0}, "its attenuation_distance is 0; it must be above 0"),
    ):
        with pytest.raises(SceneError, match=sentence):
            row(Material("odd", **fields))
