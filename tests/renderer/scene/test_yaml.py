"""Tests of Rayfarm's scene files: values are read as written, and errors name line and field."""

import numpy as np
import pytest

from renderer.errors import SceneError
from renderer.luminance import REC_709
from renderer.presets import PRESETS
from renderer.scene.description import Sky
from renderer.scene.geometry import flatten
from renderer.scene.readers.metals import METALS
from tests.renderer.scene.builders import cup

QUAD = "shapes:\n  - {type: quad}\n"


def test_whole_scene_format(scene, png):
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
    assert placed[0].max(axis=0)[0] == 7  # the first quad: x from 3 to 7
    assert placed[0].max(axis=0)[1] == 9  # the second quad, rotated upright: y from 5 to 9
    assert description.materials[description.meshes[-1].material] is table
    assert description.warnings == []


def test_material_fields_by_kind(scene, png):
    description = scene(
        "s.yaml",
        """
textures:
  t: {image: t.png, uv_set: 1, scale: [2, 3], rotate: 90, offset: [0.5, 0.25], wrap: [clamp, mirror]}
  raw: {checker: {colors: [0, 0.5], squares: 2}}
materials:
  glass: {ior: 1.7, abbe: 40, kind: glass, roughness: 0.2, thin: true, attenuation_color: 0.5, attenuation_distance: 3}
  metal: {metal: gold, roughness: 0.1, anisotropy: 0.5, anisotropy_rotation: 90, anisotropy_texture: t}
  own: {eta: 0.2, k: [3, 2, 1]}
  phong: {color: 0.5, specular_color: 0.25, shininess: 50}
  seen: {kind: unlit, texture: t, opacity: 0.5}
  holes: {texture: t, alpha_mode: mask, alpha_cutoff: 0.25, normal_texture: t, normal_scale: 2}
  film: {iridescence: 1, iridescence_ior: 1.4, iridescence_thickness: 500, iridescence_thickness_texture: t}
  coat: {clearcoat: 0.5, clearcoat_roughness: 0.1, clearcoat_normal_texture: t, clearcoat_normal_scale: 0.5, metallic: 1}
  cloth: {sheen_color: "#ffffff", sheen_roughness: 0.3, sheen_color_texture: t, specular: 0.5, specular_color: 0.9}
  leaf: {diffuse_transmission: 0.5, diffuse_transmission_color: 0.25, transmission: 0.1, dispersion: 0.3}
  rough: {metallic_roughness_texture: raw}
shapes: [{type: quad}]
""",
        {"t.png": png(1, 2, 3)},
    )
    found = {m.name: m for m in description.materials}
    kinds = {name: m.kind for name, m in found.items()}
    assert list(kinds.values())[:5] == ["glass", "conductor", "conductor", "blinn_phong", "unlit"]
    assert {kinds[name] for name in ("film", "coat", "cloth", "leaf", "rough")} == {"metallic_roughness"}
    glass, metal, own = found["glass"], found["metal"], found["own"]
    assert (glass.ior, glass.dispersion, glass.roughness, glass.thin) == (1.7, 0.5, 0.2, True)
    assert (glass.attenuation_color, glass.attenuation_distance, glass.base_color) == ((0.5,) * 3, 3, (1, 1, 1))
    assert (metal.eta, metal.k) == METALS["gold"]
    assert (metal.roughness, metal.anisotropy, metal.anisotropy_rotation) == (0.1, 0.5, np.radians(90))
    assert (own.eta, own.k) == ((0.2,) * 3, (3, 2, 1))
    assert (found["phong"].specular_color, found["phong"].shininess) == ((0.25,) * 3, 50)
    assert (found["seen"].opacity, found["seen"].alpha_mode) == (0.5, "blend")
    holes = found["holes"]
    assert (holes.kind, holes.alpha_mode, holes.alpha_cutoff, holes.normal_scale) == ("diffuse", "mask", 0.25, 2)
    colour, normal = (description.textures[t] for t in (holes.base_color_texture, holes.normal_texture))
    assert [description.images[t.image].srgb for t in (colour, normal)] == [True, False]
    assert (colour.uv_set, colour.wrap_s, colour.wrap_t) == (1, "clamp", "mirror")
    np.testing.assert_allclose(colour.transform, (0, 3, 0.5, -2, 0, 0.25), atol=1e-12)
    film, coat, cloth, leaf = (found[name] for name in ("film", "coat", "cloth", "leaf"))
    assert (film.iridescence, film.iridescence_ior, film.iridescence_thickness) == (1, 1.4, (0, 500))
    assert film.iridescence_thickness_texture == coat.clearcoat_normal_texture == holes.normal_texture
    assert (coat.clearcoat, coat.clearcoat_roughness, coat.clearcoat_normal_scale, coat.metallic) == (0.5, 0.1, 0.5, 1)
    assert (cloth.sheen_color, cloth.sheen_roughness, cloth.sheen_color_texture) == ((1, 1, 1), 0.3, holes.base_color_texture)
    assert (cloth.specular, cloth.specular_color) == (0.5, (0.9,) * 3)
    assert (leaf.diffuse_transmission, leaf.diffuse_transmission_color) == (0.5, (0.25,) * 3)
    assert (leaf.transmission, leaf.dispersion) == (0.1, 0.3)
    raw = description.images[description.textures[found["rough"].metallic_roughness_texture].image]
    assert (raw.srgb, raw.pixels[0, -1, 0]) == (False, 128)  # as data: 0.5 stays 0.5


def test_a_sky(scene):
    text = "environment: {color: [1, 2, 3], rotation: 30, sky: {sun_elevation: 10, sun: false, dust: 3, ground_albedo: 0.5}}\n"
    environment = scene("s.yaml", text + QUAD).environment
    assert environment.sky == Sky(sun_elevation=10, sun=False, dust=3, ground_albedo=(0.5, 0.5, 0.5))
    assert (environment.color, environment.rotation) == ((1, 2, 3), 30)
    assert scene("s.yaml", "environment: {sky: {}}\n" + QUAD).environment.sky == Sky()


def test_environment_preset(scene):
    for name, preset in PRESETS.items():
        found = scene("s.yaml", f"environment: {{preset: {name}, strength: 2}}\n" + QUAD)
        sky = None if preset.sky is None else Sky(*preset.sky)
        assert (found.environment.sky, found.environment.strength) == (sky, 2)
        assert len(found.images) == (sky is None and name != "even-white")


def test_lights_and_cameras(scene):
    description = scene(
        "s.yaml",
        """
lights:
  - {type: point, position: [1, 2, 3], intensity: 4, color: [1, 0.5, 0], radius: 0.25, name: bulb}
  - {type: spot, position: [0, 5, 0], target: [0, 1, 0], intensity: [1, 2, 3], inner_cone: 10, outer_cone: 20}
  - {type: directional, direction: [0, -2, 0], angle: 0.53}
cameras:
  - {eye: [0, 0, 5], target: [0, 0, 0], projection: orthographic, height: 3}
  - {eye: [0, 0, 5], target: [0, 0, 0], aperture: 0.1, focus: 2, near: 1}
  - {eye: [0, 0, 5], target: [0, 0, 0], fov: 27, f_stop: 2, focus: [1, 1, 1]}
  - {eye: [0, 0, 5], target: [0, 0, 0], projection: panorama}
shapes: [{type: quad}]
""",
    )
    point, spot, sun = description.lights
    assert (point.kind, point.name, point.position, point.intensity, point.radius) == (
        "point",
        "bulb",
        (1, 2, 3),
        (4, 2, 0),
        0.25,
    )
    assert (spot.direction, spot.intensity, spot.inner_cone, spot.outer_cone) == ((0, -1, 0), (1, 2, 3), 10, 20)
    assert (sun.kind, sun.direction, sun.intensity, sun.angle) == ("directional", (0, -1, 0), (1, 1, 1), 0.53)
    plan, lens, portrait, around = (c.view for c in description.cameras)
    assert (plan.projection, plan.height) == ("orthographic", 3)
    assert (lens.aperture, lens.focus, lens.near) == (0.1, 2, 1)
    # A 50 mm lens has this field of view on 36 x 24 mm; at f/2 its aperture is 25 mm wide.
    assert portrait.aperture == pytest.approx(0.0125, rel=1e-3)
    assert portrait.focus == 4
    assert around.projection == "panorama"


def test_polygon_shapes_flat_and_smooth(scene):
    text = """
shapes:
  - {type: faces, positions: [[0, 0, 0], [2, 0, 0], [2, 1, 0], [1, 2, 0], [0, 1, 0]], faces: [[0, 1, 2, 3, 4]]}
  - type: faces
    name: ridge
    positions: [[0, 0, 0], [1, 0.1, 0], [1, 0.1, -1], [0, 0, -1], [2, 0, 0], [2, 0, -1]]
    uvs: [[0, 0], [1, 0], [1, 1], [0, 1], [2, 0], [2, 1]]
    faces: [[0, 1, 2, 3], [1, 4, 5, 2]]
    smooth: true
"""
    pentagon, ridge = scene("s.yaml", text).meshes
    assert pentagon.normals is None
    corners = pentagon.positions[pentagon.triangles].astype(np.float64)
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] / 2
    assert areas.tolist() == [1, 1.5, 0.5]
    assert len(ridge.triangles) == 4
    top = ridge.positions[:, 1] > 0
    assert ridge.normals[top][:, 1] == pytest.approx(1)  # smooth normals point upwards along the ridge
    assert ridge.uvs[ridge.positions[:, 0] == 2].tolist() == [[2, 0], [2, 1]]


def test_objects_are_named_after_their_shapes(scene):
    text = """
shapes:
  - {type: quad, name: pane, instances: [[{translate: [1, 0, 0]}], [{translate: [2, 0, 0]}]]}
  - {type: mesh, file: cup.glb, name: cup}
  - {type: cube}
"""
    names = [i.name for i in scene("s.yaml", text, {"cup.glb": cup()}).instances]
    assert names == ["pane [0]", "pane [1]", "cup/mesh 0", "cube 2"]


def test_json_is_accepted(scene):
    assert len(scene("s.yaml", '{"shapes": [{"type": "quad"}], "name": "j"}').meshes) == 1


def test_mesh_file_materials_may_be_replaced(scene):
    others = {"m.mtl": "newmtl red\nKd 1 0 0\n", "m.obj": "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n"}
    text = "materials: {blue: {color: [0, 0, 1]}}\nshapes: [{type: mesh, file: m.obj}, {type: mesh, file: m.obj, material: blue}]"
    description = scene("s.yaml", text, others)
    assert [description.materials[m.material].base_color for m in description.meshes] == [(1, 0, 0), (0, 0, 1)]


def test_repeated_mesh_file_is_stored_once(scene, png):
    others = {"a.png": png(1, 2, 3), "m.obj": "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n"}
    shapes = ", ".join(f"{{type: mesh, file: m.obj, transform: [{{translate: [{i}, 0, 0]}}]}}" for i in range(5))
    description = scene("s.yaml", f"shapes: [{shapes}]", others)
    assert (len(description.meshes), len(description.materials), len(description.instances)) == (1, 1, 5)
    assert [i.transform[0, 3] for i in description.instances] == [0, 1, 2, 3, 4]
    assert description.images[0].name == "a.png"


@pytest.mark.parametrize(
    "shape", ["{type: quad}", "{type: disk}", "{type: cube}", "{type: lathe, profile: [[0, -1], [1, 0], [0, 1]]}"]
)
def test_builtin_shapes_face_outwards(scene, shape):
    geometry = flatten(scene("s.yaml", f"shapes: [{shape}]"))
    corners = geometry.position[geometry.triangle]
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outwards = corners.mean(axis=1) if np.ptp(corners[..., 2]) > 0 else np.array([[0, 0, 1]])
    assert ((face * outwards).sum(axis=1) > 0).all()
    normals = geometry.normal[geometry.triangle]
    assert ((normals * face[:, None]).sum(axis=2) > 0).all()
    np.testing.assert_allclose(np.linalg.norm(geometry.normal, axis=1), 1, rtol=1e-5)


def test_builtin_shape_areas(scene):
    for shape, area in (("quad", 4), ("cube", 24), ("disk", np.pi)):
        geometry = flatten(scene("s.yaml", f"shapes: [{{type: {shape}}}]"))
        corners = geometry.position[geometry.triangle].astype(np.float64)
        found = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2
        assert found == pytest.approx(area, rel=2e-4)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        ("name: a\nshapes: ]", "line 2: is not valid YAML"),
        ("hello", 'line 1: is "hello"; possible: an object'),
        ("name: x", "lacks shapes"),
        ("shapes: []", "line 1: shapes:"),
        (
            "settings:\n  roulette: 0.01\n" + QUAD,
            "line 2: settings.roulette: roulette is 0.01; it lies between 0.05 and 1, or is 0",
        ),
        ("shapes:\n  - {type: blob}", 'line 2: shapes[0].type: is "blob"; known are'),
        ("shapes:\n  - type: sphere\n    radius: -1", "line 3: shapes[0].radius"),
        ("shapes:\n  - {type: mesh}", "line 2: shapes[0]: lacks file"),
        ("shapes:\n  - {type: mesh, file: gone.obj}", "line 2: shapes[0].file: gone.obj is not among the files"),
        ("shapes:\n  - {type: mesh, file: s.yaml}", "is not a mesh file; give one of"),
        ("shapes:\n  - {type: quad}\n  - {type: quad, material: red}", "shapes[1].material: there is no material red"),
        ("materials:\n  m: {texture: t}\n" + QUAD, "materials.m.texture: there is no texture t"),
        ("materials:\n  m: {roughness: 2}\n" + QUAD, "line 2: materials.m.roughness: is 2; it must be at most 1"),
        ("materials:\n  m: {colour: 1}\n" + QUAD, "line 2: materials.m: has the unknown field colour (did you mean color?). See"),
        ("materials:\n  m: {colour: 1, zzz: 2}\n" + QUAD, "line 2: materials.m: has unknown fields: colour, zzz"),
        ("materials:\n  m: {color: [1, .nan, 1]}\n" + QUAD, "line 2: materials.m.color[1]: .nan is not a finite"),
        ("materials:\n  m: {color: red}\n" + QUAD, "line 2: materials.m.color"),
        ("cameras:\n  - {eye: [0, 0, 0], target: [0, 0, 0]}\n" + QUAD, "line 2: cameras[0]: eye and target are the same"),
        ("cameras:\n  - {eye: [0, 0, 1e999], target: [0, 0, 0]}\n" + QUAD, "finite"),
        ("name: a\nname: b\n" + QUAD, ", line 2: the key name is given twice; remove one"),
        ("shapes:\n  - type: sphere\n    transform: [{scale: [1, 2, 1]}]", "shapes[0]: a sphere needs a uniform scale"),
        (
            "shapes:\n  - type: quad\n    transform: [{rotate: {axis: [0, 0, 0], degrees: 3}}]",
            "line 3: shapes[0].transform[0].rotate",
        ),
        ("environment: {image: sky.exr, sky: {}}\n" + QUAD, "environment: has more than one of image, sky and preset"),
        ("environment: {preset: candle}\n" + QUAD, 'line 1: environment.preset: is "candle"; known are'),
        ("environment:\n  sky: {sun_size: 0}\n" + QUAD, "line 2: environment.sky.sun_size: is 0; it must be at least"),
        ("environment: {image: sky.exr}\n" + QUAD, "line 1: environment.image: sky.exr is not among"),
        ("textures: {t: {wrap: clamp}}\n" + QUAD, "needs either image or checker"),
        ("textures: {t: {image: a.png, wrap: [clamp]}}\n" + QUAD, "textures.t.wrap"),
        (
            "materials:\n  m: {kind: mirror, metallic: 1}\n" + QUAD,
            "materials.m.metallic: has no meaning for the kind mirror, only for metallic_roughness",
        ),
        (
            "materials:\n  m: {eumelanin: 1, trt: 0.5, model: chiang}\n" + QUAD,
            "line 2: materials.m.trt: has no meaning for hair of the model chiang, only for huang",
        ),
        (
            "materials:\n  m: {aspect_ratio: 0.5, beta_n: 0.5}\n" + QUAD,
            "materials.m.beta_n: has no meaning for hair of the model huang, only for chiang",
        ),
        ("materials:\n  m: {metal: cheese}\n" + QUAD, 'line 2: materials.m.metal: is "cheese"; known are'),
        ("materials:\n  m: {metal: gold, k: 1}\n" + QUAD, "materials.m: a conductor needs either metal, or eta and k"),
        ("materials:\n  m: {eta: 1}\n" + QUAD, "materials.m: a conductor needs either metal, or eta and k"),
        ("materials:\n  m: {shininess: 5}\n" + QUAD, "line 2: materials.m: blinn_phong needs its specular_color"),
        ("lights:\n  - {type: point}\n" + QUAD, "lights[0]: a point light needs a position"),
        ("lights:\n  - {type: directional, radius: 1}\n" + QUAD, "lights[0].radius: has no meaning for a directional light"),
        (
            "lights:\n  - {type: directional, direction: [0, 0, 0]}\n" + QUAD,
            "lights[0].direction: has length 0 and gives no direction",
        ),
        ("lights:\n  - {type: directional}\n" + QUAD, "line 2: lights[0]: a directional light needs a direction"),
        (
            "lights: [{type: spot, position: [0, 1, 0], target: [0, 0, 0], inner_cone: 50}]\n" + QUAD,
            "lights[0].inner_cone: is wider than the outer cone",
        ),
        (
            "cameras: [{eye: [0, 0, 1], target: [0, 0, 0], aperture: 1, f_stop: 2}]\n" + QUAD,
            "has both aperture and f_stop; give one of them",
        ),
        ("cameras: [{eye: [0, 0, 1], target: [0, 0, 0], focus: [0, 0, 9]}]\n" + QUAD, "cameras[0]: focus is -8"),
        ("shapes:\n  - {type: faces, positions: [[0, 0, 0], [1, 0, 0], [0, 1, 0]]}", "lacks faces"),
        (
            "shapes:\n  - {type: faces, positions: [[0, 0], 1, 2], faces: [[0]]}",
            "shapes[0].positions[0]: is not a list of 3 numbers",
        ),
        (
            "shapes: [{type: faces, positions: [[0, 0, 0], [1, 0, 0], [0, 1, 0]], faces: [[0, 1]]}]",
            "shapes[0].faces[0]: is not a list of three or more indices of positions",
        ),
        (
            "shapes: [{type: faces, positions: [[0, 0, 0], [1, 0, 0], [0, 1, 0]], faces: [[0, 1, 3]]}]",
            "has an index outside of 0 to 2",
        ),
        ("shapes: [{type: faces, positions: [[0, 0, 0], [1, 0, 1e300], [0, 1, 0]], faces: [[0, 1, 2]]}]", "positions[1]"),
    ],
)
def test_errors_name_line_and_field(scene, text, said):
    with pytest.raises(SceneError) as caught:
        scene("s.yaml", text)
    assert said in str(caught.value)
    assert str(caught.value).startswith("s.yaml")


def test_expanding_aliases_are_rejected(scene):
    bomb = "a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n"
    for here, before in zip("bcdefghi", "abcdefgh", strict=True):
        bomb += f"{here}: &{here} [{', '.join([f'*{before}'] * 10)}]\n"
    with pytest.raises(SceneError, match="aliases"):
        scene("s.yaml", bomb)


@pytest.mark.parametrize("bracket", ["[", "{a: ", "- "])
def test_deep_nesting_is_rejected(scene, bracket):
    with pytest.raises(SceneError, match="nested too deeply"):
        scene("s.yaml", bracket * 200_000)


def test_recursive_alias_is_rejected(scene):
    with pytest.raises(SceneError, match="nested too deeply"):
        scene("s.yaml", "a: &a [*a]\n")


def test_lights_with_a_temperature(scene):
    """Grey light gets the colour of the black body at its luminance, other light keeps its own; both get its spectrum."""
    found = scene(
        "s.yaml",
        """
lights:
  - {type: directional, direction: [0, -1, 0], intensity: 4, temperature: 2700}
  - {type: directional, direction: [0, -1, 0], color: [3, 2, 1], temperature: 3000}
materials: {bulb: {color: 0, emission: 2, emission_temperature: 9000}}
shapes: [{type: sphere, center: [0, 0, 0], radius: 1, material: bulb}]
""",
    )
    warm, own, cold = found.lights[0].intensity, found.lights[1].intensity, found.materials[0].emission
    assert np.dot(warm, REC_709) == pytest.approx(4)
    assert warm[0] > warm[1] > warm[2]
    assert own == (3, 2, 1)
    assert np.dot(cold, REC_709) == pytest.approx(2)
    assert cold[0] < cold[2]
    np.testing.assert_allclose(
        [each.color for each in found.spectra], [np.divide(c, max(c)) for c in (warm, own, cold)], rtol=1e-12
    )
