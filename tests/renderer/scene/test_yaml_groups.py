"""Tests of groups in scene files: a tree of transforms."""

import numpy as np
import pytest

from renderer.errors import SceneError
from renderer.scene.readers.yaml import geometry


def test_nested_group_transforms(scene):
    description = scene(
        "s.yaml",
        """
shapes:
- type: group
  name: village
  transform: [{translate: [100, 0, 0]}]
  shapes:
  - type: group
    name: house
    instances: [[{translate: [0, 0, 5]}], [{scale: 2}, {rotate: {axis: y, degrees: 90}}]]
    shapes:
    - {type: sphere, name: knob, center: [1, 0, 0], radius: 0.5, transform: [{translate: [0, 3, 0]}]}
    - {type: mesh, name: roof, file: roof.obj, transform: [{translate: [0, 7, 0]}], instances: [[], [{translate: [0, 1, 0]}]]}
    - {type: cube}
""",
        {"roof.obj": "o tiles\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"},
    )
    np.testing.assert_allclose(
        [(*s.center, s.radius) for s in description.spheres], [(101, 3, 5, 0.5), (100, 6, -2, 1)], atol=1e-9
    )
    assert [s.name for s in description.spheres] == ["village/house [0]/knob", "village/house [1]/knob"]
    assert len(description.meshes) == 2  # each mesh once, however often it is instanced
    names = [i.name for i in description.instances]
    assert names[:4] == [f"village/house [{i}]/roof [{j}]/roof" for i in (0, 1) for j in (0, 1)]
    assert names[4:] == [f"village/house [{i}]/cube 2" for i in (0, 1)]
    place = description.instances[3].transform
    np.testing.assert_allclose(place @ (1, 0, 0, 1), (100, 16, -2, 1), atol=1e-9)
    np.testing.assert_allclose(place @ (0, 0, 0, 1), (100, 16, 0, 1), atol=1e-9)


def test_expanding_groups_are_rejected(scene):
    text = "{type: cube}"
    for _ in range(5):
        text = f"{{type: group, shapes: [{text}], instances: [{', '.join(['[]'] * 100)}]}}"
    with pytest.raises(SceneError, match="with it the scene shows more than 1000000 shapes"):
        scene("s.yaml", f"shapes: [{text}]")


def test_mesh_file_parts_count_separately(scene, monkeypatch):
    monkeypatch.setattr(geometry, "MAX_PLACES", 30)
    triangles = "v 0 0 0\nv 1 0 0\nv 0 1 0\n" + "".join(f"usemtl {m}\nf 1 2 3\n" for m in "abcd")
    text = "shapes: [{{type: mesh, file: parts.obj, instances: [{}]}}]"
    assert len(scene("s.yaml", text.format(", ".join(["[]"] * 7)), {"parts.obj": triangles}).instances) == 28
    with pytest.raises(SceneError, match=r"shapes\[0\]: with it the scene shows more than 30 shapes"):
        scene("s.yaml", text.format(", ".join(["[]"] * 8)), {"parts.obj": triangles})


@pytest.mark.parametrize("shape", ["{type: cube}", "{type: sphere}"])
def test_overflowing_scales_are_rejected(scene, shape):
    text = shape
    for _ in range(10):
        text = f"{{type: group, transform: [{{scale: 1.0e+38}}], shapes: [{text}]}}"
    with pytest.raises(SceneError, match="combined with its parents, its transform is too large for 32-bit numbers"):
        scene("s.yaml", f"shapes: [{text}]")
    with pytest.raises(
        SceneError, match=r"shapes\[0\]\.transform\[1\]: combined with its parents, its transform is too large for 32-bit numbers"
    ):
        scene("s.yaml", "shapes: [{type: cube, transform: [{scale: 1.0e+200}, {scale: 1.0e+200}]}]")


@pytest.mark.parametrize(
    ("shape", "said"),
    [
        ("{type: group}", "line 2: shapes[0]: lacks shapes"),
        ("{type: cube, shapes: [{type: cube}]}", "line 2: shapes[0].shapes: is not allowed here"),
        ("{type: group, material: m, shapes: [{type: cube}]}", "line 2: shapes[0].material: is not allowed here"),
        ("{type: group, shapes: [{type: cube}, {type: blob}]}", 'shapes[0].shapes[1].type: is "blob"'),
        ("{type: cube, name: a, file: a}", "line 2: shapes[0].file: is not allowed here"),
        ("{type: sphere, guide: true, smooth: true}", "line 2: shapes[0].smooth: is not allowed here"),
        (
            "{type: group, shapes: [{type: group, shapes: [{type: cube, radius: 1}]}]}",
            "shapes[0].shapes[0].shapes[0].radius: is not allowed here",
        ),
    ],
)
def test_errors_name_line_and_field(scene, shape, said):
    with pytest.raises(SceneError) as caught:
        scene("s.yaml", f"shapes:\n  - {shape}\nmaterials: {{m: {{}}}}\n")
    assert said in str(caught.value)
