"""Tests of sequences with one file per frame: meshes as simulations write them, and textures."""

import numpy as np
import pytest

from renderer.errors import SceneError
from renderer.scene.animation import Moment
from renderer.scene.load import Shot
from tests.renderer.scene.builders import world

SUFFIXES = ("obj", "ply", "stl")


def drop(height, suffix):
    """Returns a triangle at the given height, as the text of a file with this suffix."""
    points = [(0, height, 0), (1, height, 0), (0, height, 1)]
    if suffix == "obj":
        return "".join(f"v {x} {y} {z}\n" for x, y, z in points) + "f 1 2 3\n"
    if suffix == "ply":
        head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        return head + "".join(f"{x} {y} {z}\n" for x, y, z in points) + "3 0 1 2\n"
    corners = "".join(f"vertex {x} {y} {z}\n" for x, y, z in points)
    return f"solid a\nfacet normal 0 1 0\nouter loop\n{corners}endloop\nendfacet\nendsolid a\n"


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_file_of_the_frame_is_read(scene, tmp_path, suffix):
    for number, height in ((1, 5), (2, 3), (10, 0)):
        (tmp_path / f"drop.{number:03d}.{suffix}").write_text(drop(height, suffix))
    shot = Shot(tmp_path, f"drop.###.{suffix}")
    assert shot.start == 1
    for number, height in ((10, 0), (1, 5), (2, 3), (2.5, 3)):
        description = shot.scene_at(Moment(number))
        points = world(description).reshape(-1, 3)
        up = 1 if suffix != "stl" else int(np.argmin(np.ptp(points, axis=0)))
        np.testing.assert_allclose(np.abs(points[:, up]), height)
        assert description.moves
    with pytest.raises(SceneError, match=rf"drop\.003\.{suffix} is not among the scene's files; add it"):
        shot.scene_at(Moment(3))


def test_scene_file_patterns_for_meshes_and_textures(scene, png):
    files = {
        "sim/drop.01.obj": drop(5, "obj"),
        "sim/drop.02.obj": drop(3, "obj"),
        "w1.png": png(255, 0, 0),
        "w2.png": png(0, 255, 0),
    }
    text = """
    textures: {wall: {image: w#.png}}
    materials: {wall: {texture: wall}}
    shapes: [{type: mesh, file: sim/drop.##.obj}, {type: quad, material: wall}]
    """
    for number, height, color in ((1, 5, (255, 0, 0)), (2, 3, (0, 255, 0))):
        description = scene("s.yaml", text, files, moment=Moment(number))
        assert (world(description)[0, :, 1] == height).all()
        assert tuple(description.images[0].pixels[0, 0, :3]) == color
        assert description.moves
    with pytest.raises(SceneError, match=r"line 4: shapes\[0\]\.file: sim/drop\.03\.obj is not among the files; add it"):
        scene("s.yaml", text, files, moment=Moment(3))


def test_file_named_like_a_pattern_is_used_itself(scene):
    description = scene("a#.obj", drop(7, "obj"), {"a1.obj": drop(8, "obj")}, moment=Moment(1))
    assert (world(description)[0, :, 1] == 7).all()
    assert not description.moves


def test_data_of_earlier_frames_are_dropped(scene, png, tmp_path):
    files = {f"w{i}.png": png(i, 0, 0) for i in range(6)} | {"still.png": png(9, 9, 9)}
    text = """
    textures: {wall: {image: w#.png}, still: {image: still.png}}
    materials: {a: {texture: wall}, b: {texture: still}}
    shapes: [{type: quad, material: a}, {type: quad, material: b}]
    """
    scene("s.yaml", text, files)
    shot = Shot(tmp_path, "s.yaml")
    kept = []
    for number in range(6):
        description = shot.scene_at(Moment(number))
        kept.append(description.images[1].pixels)
    assert all(pixels is kept[0] for pixels in kept), "what stays is decoded once"
    held = [key for key in shot._files._made if key[0] == "pixels"]
    assert sorted(name for _, name in held) == ["still.png", "w4.png", "w5.png"]


def test_numbered_meshes_move_while_the_shutter_is_open(tmp_path):
    for number, height in ((1, 5), (2, 3), (3, 2)):
        (tmp_path / f"drop.{number}.obj").write_text(drop(height, "obj"))
    shot = Shot(tmp_path, "drop.#.obj")
    moving = shot.over_shutter(Moment(2), {"shutter": 1.0, "shutter_keys": 5})
    heights = [float(positions[0, 1]) for positions, _ in moving.meshes[0].keys]
    np.testing.assert_allclose(heights, [4.0, 3.5, 3.0, 2.75, 2.5])
    trailing = shot.over_shutter(Moment(2), {"shutter": 0.5, "shutter_at": "trailing", "shutter_keys": 2})
    np.testing.assert_allclose([float(positions[0, 1]) for positions, _ in trailing.meshes[0].keys], [4.0, 3.0])
    last = shot.over_shutter(Moment(3), {"shutter": 1.0, "shutter_keys": 3})
    np.testing.assert_allclose([float(positions[0, 1]) for positions, _ in last.meshes[0].keys], [2.5, 2.0, 2.0])


def test_meshes_with_changed_topology_are_not_blurred(tmp_path):
    (tmp_path / "drop.1.obj").write_text(drop(5, "obj"))
    (tmp_path / "drop.2.obj").write_text(drop(3, "obj") + "v 0 0 9\nf 1 2 4\n")
    moving = Shot(tmp_path, "drop.#.obj").over_shutter(Moment(1), {"shutter": 0.5})
    assert moving.keys == 0
    assert not moving.meshes[0].keys
    assert any("whose triangles change" in warning for warning in moving.warnings)
