"""Tests of the default camera of rooms: it stands inside, and only in rooms."""

import time
from dataclasses import replace

import numpy as np
import pytest

from protocol.contract import home_camera
from renderer.scene.compile import camera_dicts
from renderer.scene.description import Camera, Environment, Instance, Mesh, SceneDescription
from renderer.scene.room_camera import room_view
from renderer.settings import View
from tests.renderer.builders import box

BOUNDS = np.array([(-4.0, 0.0, -3.0), (4.0, 3.0, 3.0)])
WALLS = np.diag([8.0, 3.0, 6.0, 1.0])
WALLS[:3, 3] = 0, 1.5, 0
MIRRORED = WALLS @ np.diag([-1.0, 1, 1, 1])


def unit_box():
    made = box(0)
    low, high = made.positions.min(axis=0), made.positions.max(axis=0)
    return replace(made, positions=((made.positions - low) / (high - low) - 0.5).astype(np.float32))


def scene(walls, place=WALLS, thing=(0.0, 0.5, 0.0), size=1.0):
    """Returns a scene of walls with a cube in them; thing: its middle; None: no cube."""
    cube = np.diag([size, size, size, 1.0])
    meshes, instances = [walls], [Instance(0, place)]
    if thing is not None:
        cube[:3, 3] = thing
        meshes.append(unit_box())
        instances.append(Instance(1, cube))
    return SceneDescription(meshes=meshes, instances=instances)


def inwards(mesh):
    normals = None if mesh.normals is None else -mesh.normals
    return replace(mesh, triangles=mesh.triangles[:, ::-1].copy(), normals=normals)


def without(mesh, axis, side):
    """Returns a box without the face at the upper (1) or lower (-1) end of an axis."""
    kept = (mesh.positions[mesh.triangles][:, :, axis] * side < 0.4).any(axis=1)
    return replace(mesh, triangles=mesh.triangles[kept])


@pytest.mark.parametrize("normals", [True, False])
@pytest.mark.parametrize("missing", [None, (1, 1), (2, 1)])
def test_camera_stands_in_a_room(normals, missing):
    walls = inwards(unit_box())
    walls = walls if missing is None else without(walls, *missing)
    view = room_view(scene(walls if normals else replace(walls, normals=None)), BOUNDS)
    assert view is not None
    assert (BOUNDS[0] < view.eye).all()
    assert (view.eye < BOUNDS[1]).all()
    assert np.linalg.norm(view.target) < 3


@pytest.mark.parametrize("normals", [True, False])
def test_mirrored_room_is_a_room(normals):
    walls = inwards(unit_box())
    walls = walls if normals else replace(walls, normals=None)
    assert room_view(scene(walls, MIRRORED), BOUNDS) is not None


@pytest.mark.parametrize(
    "description",
    [
        scene(unit_box()),
        scene(inwards(unit_box()), thing=None),
        scene(without(inwards(unit_box()), 1, -1)),
        scene(without(without(inwards(unit_box()), 0, 1), 2, 1)),
    ],
    ids=["faces outwards", "empty", "without a floor", "two walls"],
)
def test_other_scenes_are_seen_from_outside(description):
    assert room_view(description, BOUNDS) is None
    corners = np.array([np.where(which, BOUNDS[1], BOUNDS[0]) for which in np.ndindex(2, 2, 2)])
    (camera,) = camera_dicts(description, BOUNDS, corners)
    assert not ((BOUNDS[0] < camera["view"]["eye"]) & (camera["view"]["eye"] < BOUNDS[1])).all()


def test_camera_of_many_objects_in_a_room_is_found_without_examining_all():
    """A heap of large objects in the middle leaves the usual corner free. Their vertices would take 2 GB at once."""
    heap = Mesh(
        "heap", np.random.default_rng(1).random((10_000, 3), np.float32) - 0.5, np.arange(9_999, dtype=np.int32).reshape(-1, 3)
    )
    made = scene(inwards(unit_box()))
    made.meshes.append(heap)
    place = np.diag([1.0, 1.0, 1.0, 1.0])
    place[:3, 3] = 0, 1.5, 0
    made.instances += [Instance(2, place)] * 10_000
    begun = time.process_time()
    assert room_view(made, BOUNDS) == room_view(scene(inwards(unit_box())), BOUNDS)
    assert time.process_time() - begun < 10


def test_camera_avoids_what_stands_in_its_corner():
    usual = room_view(scene(inwards(unit_box())), BOUNDS)
    other = room_view(scene(inwards(unit_box()), thing=usual.eye, size=0.5), BOUNDS)
    assert other.eye[0] < 0 < usual.eye[0]


@pytest.mark.parametrize(
    ("target", "more", "is_blind"),
    [
        ((0.0, 0.0, 9.0), {}, True),
        ((0.0, 0.0, 0.0), {}, False),
        ((9.0, 0.0, 4.0), {}, True),
        ((9.0, 0.0, 4.0), {"fov": 120.0}, False),
        ((0.0, 0.0, 9.0), {"projection": "panorama"}, False),
        ((4.0, 0.0, 0.0), {"fov": 20.0}, True),
        ((4.0, 0.0, 0.0), {"fov": 20.0, "shift_x": -1.5}, False),
        ((0.0, 0.0, 0.0), {"near": 9.0}, True),
        ((0.0, 9.0, 4.01), {"projection": "orthographic"}, True),
    ],
)
def test_camera_that_sees_nothing_is_marked(target, more, is_blind):
    """The page opens such a scene with the automatic camera; a camera that sees a corner of the bounds is not marked."""
    view = View((0.0, 0.0, 4.0), target, **more)
    description = SceneDescription(cameras=[Camera("own", view)])
    corners = np.array([(x, y, z) for x in (-1.0, 1) for y in (-1.0, 1) for z in (-1.0, 1)])
    own, automatic = camera_dicts(description, np.array([(-1.0, -1, -1), (1.0, 1, 1)]), corners)
    assert own.get("sees_nothing", False) is is_blind
    assert "sees_nothing" not in automatic
    assert home_camera([own, automatic]) == int(is_blind)
    description.environment = Environment()
    assert "sees_nothing" not in camera_dicts(description, np.array([(-1.0, -1, -1), (1.0, 1, 1)]), corners)[0]
    description.environment = Environment(strength=0.0)
    assert camera_dicts(description, np.array([(-1.0, -1, -1), (1.0, 1, 1)]), corners) == [own, automatic]
