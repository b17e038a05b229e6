"""Tests of layered textures in scene files: a list of textures is read as layers, and errors name the line and the layer."""

import pytest

from renderer.errors import SceneError

CHECKER = "textures: {t: {checker: {colors: [0, 1]}}}\nshapes: [{type: quad}]\n"


def test_texture_list_becomes_layers(scene, png):
    description = scene(
        "s.yaml",
        """
textures: {brick: {image: b.png}, dirt: {image: d.png, uv_set: 1}, snow: {checker: {colors: [0, 1]}}, gone: {image: gone.png}}
materials:
  wall:
    texture: [brick, {texture: dirt, blend: multiply, strength: 0.5}, {texture: gone, blend: add}, snow]
    emission_texture: [snow, {texture: snow, blend: add}]
    metallic_roughness_texture: [dirt, {texture: snow, strength: 0}]
  plain: {texture: [brick]}
shapes: [{type: quad}]
""",
        {"b.png": png(1, 2, 3), "d.png": png(4, 5, 6)},
    )
    textures, images = description.textures, description.images
    wall, plain = description.materials[:2]
    lowest = textures[wall.base_color_texture]
    assert images[lowest.image].name == "b.png"
    assert [(layer.blend, layer.strength) for layer in lowest.layers] == [
        ("multiply", 0.5),
        ("over", 1),
    ]  # the layer with a missing image is dropped
    above = [textures[layer.texture] for layer in lowest.layers]
    assert [(images[t.image].name, images[t.image].srgb, t.uv_set) for t in above] == [("d.png", True, 1), ("snow", True, 0)]
    rough = textures[wall.metallic_roughness_texture]
    assert [images[t.image].srgb for t in (rough, textures[rough.layers[0].texture])] == [False, False]
    assert textures[wall.emission_texture].layers[0].blend == "add"
    assert textures[plain.base_color_texture].layers == ()
    assert any("gone.png is not among" in w for w in description.warnings)


def test_layers_of_a_mesh_file_are_merged(scene, png):
    files = {
        "own.png": png(1, 1, 1),
        "a.png": png(2, 2, 2),
        "shape.png": png(3, 3, 3),
        "m.mtl": "newmtl m\nKd 1 0 0\nmap_Kd a.png\ndecal shape.png\n",
        "m.obj": "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n",
    }
    text = "textures: {o: {image: own.png}}\nmaterials: {x: {texture: o}}\nshapes: [{type: mesh, file: m.obj}]\n"
    description = scene("s.yaml", text, files)
    lowest = description.textures[description.materials[1].base_color_texture]
    assert description.images[lowest.image].name == "a.png"
    (layer,) = lowest.layers
    assert description.images[description.textures[layer.texture].image].name == "shape.png as a decal"


@pytest.mark.parametrize(
    ("slot", "said"),
    [
        ("texture: [a]", "materials.m.texture[0]: there is no texture a"),
        ("texture: []", "materials.m.texture: has 0 of at least 1 items"),
        (
            "texture: [{texture: t}]",
            "materials.m.texture[0]: has nothing beneath it: the first layer must be the name of a texture",
        ),
        ("texture: [t, 3]", "line 2: materials.m.texture[1]: is 3; possible: a text"),
        ("texture: [t, {blend: add}]", "materials.m.texture[1]: lacks texture"),
        ("texture: [t, {texture: t, blend: melt}]", 'texture[1].blend: is "melt"; known are'),
        ("texture: [t, {texture: t, strength: 2}]", "texture[1].strength: is 2; it must be at most 1"),
        ("texture: [t, {texture: u}]", "materials.m.texture[1]: there is no texture u"),
        ("normal_texture: [t, t]", "line 2: materials.m.normal_texture: takes one texture"),
    ],
)
def test_errors_name_line_and_layer(scene, slot, said):
    with pytest.raises(SceneError) as caught:
        scene("s.yaml", f"materials:\n  m: {{{slot}}}\n{CHECKER}")
    assert said in str(caught.value)
