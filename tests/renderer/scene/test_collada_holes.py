"""Tests of Collada polygons with holes: holes are cut out, and those that cannot be cut out are counted in a warning."""

import numpy as np
import pytest

from renderer.errors import SceneError
from renderer.scene.normals import face_normals

SQUARE = [(0, 0), (4, 0), (4, 4), (0, 4)]
HOLES = [[(1, 1), (1, 2), (2, 2), (2, 1)], [(2.5, 2.5), (3.5, 2.5), (3.5, 3.5), (2.5, 3.5)]]


def document(points, holes, outline="0 1 2 3", semantic="VERTEX"):
    numbers = " ".join(f"{x} {y} {0.5 * x + 0.25 * y}" for x, y in points)
    loops = "".join(f"<h>{hole}</h>" for hole in holes)
    return f"""<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
    <library_geometries><geometry id="g"><mesh><source id="p">
    <float_array id="a" count="{3 * len(points)}">{numbers}</float_array>
    <technique_common><accessor source="#a" count="{len(points)}" stride="3"><param name="X" type="float"/>
    <param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
    <vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
    <polygons count="1"><input semantic="VERTEX" source="#v" offset="0"/><ph><p>{outline}</p>{loops}</ph></polygons>
    </mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"/>
    </node></visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


@pytest.mark.parametrize(
    ("points", "holes", "area"),
    [
        (SQUARE + HOLES[0], ["4 5 6 7"], 15),
        (SQUARE + HOLES[0], ["7 6 5 4"], 15),
        (SQUARE + HOLES[0] + HOLES[1], ["4 5 6 7", "8 9 10 11"], 14),
        (SQUARE, ["0 1 2"], 8),  # the hole shares the outline's edges
        (SQUARE, [], 16),
        ([*SQUARE, (2, 0), (2, 2), (1, 1)], ["0 4 5 6"], 14),
    ],
)
def test_holes_are_cut_out(scene, points, holes, area):
    description = scene("a.dae", document(points, holes))
    found = sum(np.linalg.norm(face_normals(m.positions, m.triangles), axis=1).sum() / 2 for m in description.meshes)
    assert found == pytest.approx(area * np.sqrt(1 + 0.5**2 + 0.25**2), rel=1e-5)


def test_uncuttable_holes_are_counted(scene):
    description = scene("a.dae", document(SQUARE + HOLES[0], ["4 5 99"]))
    assert any("1 holes of polygons could not be cut" in w for w in description.warnings)


@pytest.mark.parametrize(("old", "new"), [('offset="0"', 'offset="-"'), ("4 5 6 7", "4 5 x 7")])
def test_non_numeric_indices_are_an_error_message(scene, old, new):
    text = document(SQUARE + HOLES[0], ["4 5 6 7"])
    try:
        scene("a.dae", text.replace(old, new))
    except SceneError as error:
        assert "could not be read as" not in str(error)
