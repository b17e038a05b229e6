"""Tests of the page's default camera of scenes with a floor, against the renderer's."""

from __future__ import annotations

import numpy as np
import pytest

from renderer.scene.description import Mesh
from renderer.scene.standing import standing_box, within_footprint
from tests.page.node import Node
from tests.renderer.scene.floors import FRAMED_WHOLE, FRAMED_WITHOUT_FLOOR, scene

FRAMED = """
    const identity = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
    const drawn = a.map((positions) => ({ shape: { positions: Float32Array.from(positions), indices: [] }, matrix: identity }));
    return [...m.framedPlaces(drawn, Float64Array.from(a.flat()))];"""
MANY = """
    const matrix = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];
    const [floor, thing] = [[-4, 0, -4, 4, 0, 4], [-1, 0, -1, 1, 1, 1]].map((positions) => ({ positions, indices: [] }));
    const drawn = [...Array(a)].map((_, i) => ({ shape: i % 2 ? thing : floor, matrix }));
    return [...m.framedPlaces(drawn, Float64Array.of(...floor.positions, ...thing.positions))];"""


@pytest.mark.parametrize("parts", [*FRAMED_WITHOUT_FLOOR, *FRAMED_WHOLE])
def test_page_frames_the_same_points_as_the_renderer(node: Node, parts: list[Mesh]) -> None:
    description = scene(*parts)
    points = np.concatenate([np.zeros((0, 3)), *(mesh.positions for mesh in parts)])
    box = standing_box(description)
    expected = points if box is None else within_footprint(description, points, box)
    found = node.call("mesh/standing", FRAMED, [mesh.positions.ravel().tolist() for mesh in parts])
    np.testing.assert_array_equal(np.reshape(found, (-1, 3)), expected)


def test_page_frames_scenes_of_many_objects(node: Node) -> None:
    """The page frames scenes of more objects than a function can have arguments."""
    assert node.call("mesh/standing", MANY, 300_000) == [-1, 0, -1, 1, 1, 1]
