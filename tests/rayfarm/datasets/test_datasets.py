"""Tests of data sets in this process: cameras, files, resuming, and the forms that other programs read."""

from __future__ import annotations

import json
import tarfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from pycocotools.coco import COCO

import rayfarm
from rayfarm import Cameras
from rayfarm.datasets.cameras import opencv
from rayfarm.datasets.document import dataset_of_file
from rayfarm.datasets.sinks import write_transforms
from renderer.errors import RayfarmError, SettingsError
from renderer.image.read import read
from renderer.lens_distortion import LensDistortion
from tests.helpers import ROOT
from tests.renderer.kernel.test_distortion import opencv as opencv_pixels

CORNELL = ROOT / "scenes" / "cornell-box.yaml"
CAMERAS = Cameras.orbit(3, radius=3.1, target=(0.0, 1.0, 0.0), elevation=12.0, turns=0.12, start=-105.0)
SMALL: dict[str, Any] = {"width": 64, "height": 48, "spp": 2, "max_depth": 3, "seed": 5}
K = np.array([[70.0, 0.0, 30.5], [0.0, 70.0, 25.25], [0.0, 0.0, 1.0]])


def plane(folder: Path, name: str, view: int) -> np.ndarray:
    return np.load(folder / name / f"{view:06}.npy")


def made(folder: Path, outputs: list[str], **more: Any) -> rayfarm.Dataset:
    given = {"intrinsics": K, "cameras": CAMERAS, **SMALL, **more}
    return rayfarm.dataset(CORNELL, folder=folder, outputs=outputs, **given)


def test_flow_is_depth_and_pose(tmp_path: Path) -> None:
    """Computed from nothing but the files: depth, intrinsics and poses, in OpenCV's convention."""
    found = made(tmp_path / "a", ["depth", "distance", "position", "flow_forward", "flow_backward"])
    k, poses = np.array(found.description["intrinsics"]), [np.array(v["world_to_camera_opencv"]) for v in found.views]
    y, x = np.mgrid[0:48, 0:64] + 0.5
    rays = np.stack([(x - k[0, 2]) / k[0, 0], (y - k[1, 2]) / k[1, 1], np.ones_like(x)], -1)
    moved = 0.0
    for name, view, other in (("flow_forward", 0, 1), ("flow_forward", 1, 2), ("flow_backward", 1, 0), ("flow_backward", 2, 1)):
        depth = plane(tmp_path / "a", "depth", view).astype(np.float64)
        met = np.isfinite(depth)
        points = rays * np.where(met, depth, 0.0)[..., None]
        np.testing.assert_allclose(np.linalg.norm(points, axis=-1)[met], plane(tmp_path / "a", "distance", view)[met], rtol=1e-5)
        there = (points[met] - poses[view][:3, 3]) @ poses[view][:3, :3]
        np.testing.assert_allclose(there, plane(tmp_path / "a", "position", view)[met], atol=1e-5)
        seen = (there @ poses[other][:3, :3].T + poses[other][:3, 3]) @ k.T
        expected = seen[:, :2] / seen[:, 2:] - np.stack([x, y], -1)[met]
        np.testing.assert_allclose(plane(tmp_path / "a", name, view)[met], expected, atol=1e-3)
        moved = max(moved, float(np.abs(expected).max()))
        assert 0.01 < plane(tmp_path / "a", f"{name}_occluded", view).mean() < 0.9
    assert moved > 3
    assert "flow_forward" not in found.views[2]["files"] and "flow_backward" not in found.views[0]["files"]


@pytest.mark.filterwarnings("ignore:__array__ implementation:DeprecationWarning")  # of pycocotools under NumPy 2
def test_the_coco_file_has_the_masks_of_the_ids(tmp_path: Path) -> None:
    categories = {"*-wall": "wall", "*-box": "box", "back": "wall"}
    made(tmp_path / "a", ["instance", "category", "masks"], sinks=["coco"], categories=categories)
    coco = COCO(str(tmp_path / "a" / "coco.json"))
    assert [each["name"] for each in coco.loadCats(coco.getCatIds())] == ["box", "wall"]
    assert len(coco.getImgIds()) == 3
    occluded = 0
    for image in coco.getImgIds():
        ids, kinds = plane(tmp_path / "a", "instance", image - 1), plane(tmp_path / "a", "category", image - 1)
        annotations = coco.loadAnns(coco.getAnnIds(imgIds=[image]))
        assert {each["instance"] for each in annotations} == {*np.unique(ids[kinds > 0]).tolist()}
        for each in annotations:
            mask = coco.annToMask(each).astype(bool)
            np.testing.assert_array_equal(mask, ids == each["instance"])
            assert (kinds[mask] == each["category_id"]).all() and mask.sum() == each["area"]
            rows, columns = np.nonzero(mask)
            x, y, w, h = each["bbox"]
            assert (x, y, x + w - 1, y + h - 1) == (columns.min(), rows.min(), columns.max(), rows.max())
            whole = coco.annToMask({**each, "segmentation": each["amodal_segmentation"]}).astype(bool)
            assert (whole | ~mask).all() and each["occlusion"] == pytest.approx(1 - mask.sum() / whole.sum(), abs=1e-6)
            occluded += bool(each["occlusion"] > 0)
    assert occluded > 2


def test_a_run_continues_and_the_same_seed_gives_the_same_bits(tmp_path: Path) -> None:
    outputs = ["color", "normal_camera", "boxes"]
    whole = made(tmp_path / "a", outputs, sinks=["transforms", "webdataset"])

    def stop(done: int, total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        made(tmp_path / "b", outputs, watch=stop)
    with (tmp_path / "b" / "manifest.jsonl").open("a") as file:
        file.write('{"view": 2, "dig')  # a crash while it was written
    (tmp_path / "b" / "color" / "000000.png").unlink()
    before = (tmp_path / "b" / "color" / "000001.png").stat().st_mtime_ns
    again = made(tmp_path / "b", outputs, sinks=["webdataset"])
    assert (tmp_path / "b" / "color" / "000001.png").stat().st_mtime_ns == before
    assert again.views == whole.views and len({*whole.digests}) == 3
    shards = [(tmp_path / name / "shards" / "000000.tar").read_bytes() for name in "ab"]
    assert shards[0] == shards[1]
    with tarfile.open(tmp_path / "a" / "shards" / "000000.tar") as tar:
        names = tar.getnames()
    assert names[:4] == ["000000.boxes.json", "000000.color.png", "000000.normal_camera.npy", "000000.json"]
    assert made(tmp_path / "a", outputs).views == whole.views  # nothing is left to render
    with pytest.raises(SettingsError, match="holds another data set"):
        made(tmp_path / "a", outputs, **{**SMALL, "seed": 6})
    read = Cameras.from_transforms(tmp_path / "a" / "transforms.json")
    np.testing.assert_array_equal(read.poses, CAMERAS.poses)
    np.testing.assert_array_equal(read.intrinsics, K)
    assert read.size == (64, 48)


def test_colmap_and_both_conventions_give_the_same_cameras(tmp_path: Path) -> None:
    (tmp_path / "cameras.txt").write_text("# a camera\n1 PINHOLE 64 48 70 70 30.5 25.25\n")
    rows = []
    for n, pose in enumerate(CAMERAS.poses):
        matrix = opencv(pose)
        r = matrix[:3, :3]
        w = np.sqrt(max(0.0, 1 + np.trace(r))) / 2
        q = np.array([w, *((r[[2, 0, 1], [1, 2, 0]] - r[[1, 2, 0], [2, 0, 1]]) / (4 * w))])
        rows.append(f"{n + 1} {' '.join(f'{v:.17g}' for v in (*q, *matrix[:3, 3]))} 1 {n:03}.png\n10.0 20.0 -1\n")
    (tmp_path / "images.txt").write_text("".join(rows))
    read = Cameras.from_colmap(tmp_path)
    np.testing.assert_allclose(read.poses, CAMERAS.poses, atol=1e-12)
    assert read.size == (64, 48) and np.array_equal(read.intrinsics, K)
    of_opencv = Cameras.of([np.linalg.inv(opencv(pose)) for pose in CAMERAS.poses], "opencv")
    np.testing.assert_allclose(of_opencv.poses, CAMERAS.poses, atol=1e-12)


def test_view_n_shows_frame_n_and_flow_has_the_motion_of_things(tmp_path: Path) -> None:
    """A quad that faces the camera at distance 4 moves by 0.2 a frame to the right, and a still camera sees it move."""
    scene = {
        "environment": {"color": 1},
        "shapes": [
            {"type": "quad", "name": "wall", "transform": [{"scale": 9}, {"translate": [0, 0, -2]}]},
            {
                "type": "quad",
                "name": "sign",
                "transform": [{"scale": 0.45}, {"translate": {"keys": [[0, [0, 0, 0]], [1, [4.8, 0, 0]]]}}],
            },
        ],
    }
    pose = np.eye(4)
    pose[2, 3] = 4.0
    outputs = ["object", "part", "flow_forward", "flow_backward", "scene_flow_forward", "scene_flow_backward", "boxes"]
    found = rayfarm.dataset(scene, [pose] * 3, folder=tmp_path / "a", intrinsics=K, outputs=outputs, fps=24, width=64, height=48)
    assert found.description["objects"] == ["wall", "sign"]
    step = 70 * 0.2 / 4
    for view in range(3):
        sign = plane(tmp_path / "a", "object", view) == 2
        materials = len(found.description["materials"])
        part = plane(tmp_path / "a", "part", view)
        np.testing.assert_array_equal((part - 1) // materials + 1, plane(tmp_path / "a", "object", view))
        left = 30.5 + step * view - 70 * 0.45 / 4
        assert np.flatnonzero(sign.any(axis=0))[0] == np.ceil(left - 0.5)
        for name, way, other in (("flow_forward", step, view + 1), ("flow_backward", -step, view - 1)):
            if not 0 <= other < 3:
                continue
            moved = plane(tmp_path / "a", f"scene_{name}", view)
            np.testing.assert_allclose(moved[sign], np.broadcast_to([0.2 * np.sign(way), 0, 0], (sign.sum(), 3)), atol=1e-6)
            np.testing.assert_allclose(moved[~sign], 0, atol=1e-6)
            flow, hidden = (plane(tmp_path / "a", each, view) for each in (name, f"{name}_occluded"))
            np.testing.assert_allclose(flow[sign], np.broadcast_to([way, 0], (sign.sum(), 2)), atol=1e-4)
            np.testing.assert_allclose(flow[~sign], 0, atol=1e-4)
            behind = plane(tmp_path / "a", "object", other) == 2
            np.testing.assert_array_equal(hidden[~sign], behind[~sign])
            assert not hidden[sign].any() and hidden.sum() > 20
        (body,) = (b for b in json.loads((tmp_path / "a" / "boxes" / f"{view:06}.json").read_text()) if b["name"] == "sign")
        assert body["box"] == body["amodal_box"] and np.mean(body["box_3d"], axis=0)[0] == pytest.approx(0.2 * view, abs=1e-5)


@pytest.mark.long
def test_a_rolling_shutter_leans_what_moves_in_every_output(tmp_path: Path) -> None:
    """The sign of above at the time of each row, which dataset.json has: ids, picture and flow agree with it."""
    move = {"translate": {"keys": [[0, [0, 0, 0]], [1, [9.6, 0, 0]]]}}
    scene = {
        "environment": {"color": 0},
        "materials": {"bright": {"kind": "unlit", "color": [1, 1, 1]}},
        "shapes": [{"type": "quad", "name": "sign", "material": "bright", "transform": [{"scale": 0.45}, move]}],
    }
    pose = np.eye(4)
    pose[2, 3] = 4.0
    found = rayfarm.dataset(
        *(scene, [pose] * 3),
        folder=tmp_path / "a",
        intrinsics=K,
        outputs=["color", "object", "depth", "flow_forward"],
        plane_format="npy",
        picture_format="exr",
        **{**SMALL, "fps": 24, "shutter": 0.5, "rolling_shutter": 1.0, "filter": "box", "spp": 16},
    )
    rows = found.description["rolling_shutter"]
    assert rows == {"from": "top", "first": pytest.approx(0.5 * (0.5 / 48 - 0.5)), "step": pytest.approx(0.5 / 48), "exposure": 0}
    x = np.arange(64) + 0.5
    for view in (1, 2):
        sign = plane(tmp_path / "a", "object", view) == 1
        color = read((tmp_path / "a" / "color" / f"{view:06}.exr").read_bytes(), "a.exr")[..., 0]
        for row in np.flatnonzero(sign.any(axis=1))[1:-1]:
            middle = 30.5 + 70 * 0.4 * (view + rows["first"] + row * rows["step"]) / 4
            inside, margin = abs(x - middle) < 70 * 0.45 / 4, abs(abs(x - middle) - 70 * 0.45 / 4) > 1e-3
            np.testing.assert_array_equal(sign[row, margin], inside[margin])
            covered = np.clip(np.minimum(x + 0.5, middle + 7.875) - np.maximum(x - 0.5, middle - 7.875), 0, 1)
            np.testing.assert_allclose(color[row], covered, atol=0.15)
            assert color[row].sum() == pytest.approx(15.75, abs=0.15)
        if view == 1:  # the rows of the point are the same in both frames
            np.testing.assert_allclose(plane(tmp_path / "a", "flow_forward", 1)[sign], [(7.0, 0.0)] * sign.sum(), atol=1e-3)
    leaning = plane(tmp_path / "a", "object", 1)
    first, last = np.flatnonzero(leaning.any(axis=1))[[0, -1]]
    assert np.flatnonzero(leaning[last])[0] > np.flatnonzero(leaning[first])[0]


def test_an_amodal_mask_is_what_the_object_alone_would_show(tmp_path: Path) -> None:
    whole = yaml.safe_load(CORNELL.read_text())
    made(tmp_path / "whole", ["masks"])
    found = {}
    for view in range(3):
        for body in json.loads((tmp_path / "whole" / "boxes" / f"{view:06}.json").read_text()):
            found[body["name"], view] = body["amodal_mask"], body["occlusion"]
    hidden, _ = max(found, key=lambda each: found[each][1])
    assert max(occlusion for _, occlusion in found.values()) > 0.05
    alone = {**whole, "shapes": [each for each in whole["shapes"] if each["name"] == hidden], "environment": {"color": 1}}
    rayfarm.dataset(alone, CAMERAS, folder=tmp_path / "alone", outputs=["masks"], intrinsics=K, **SMALL)
    for view in range(3):
        bodies = json.loads((tmp_path / "alone" / "boxes" / f"{view:06}.json").read_text())
        assert [body["mask"] for body in bodies] == ([found[hidden, view][0]] if (hidden, view) in found else [])


REFLECTED = np.diag([-1.0, 1.0, 1.0, 1.0])
WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "no cameras": ({"cameras": np.zeros((0, 4, 4))}, "cameras is empty"),
    "shape": ({"cameras": np.eye(3)}, "cameras has the shape"),
    "sheared": ({"cameras": [np.eye(4), np.eye(4) + np.eye(4, k=1)]}, r"cameras\[1\] .*last row|cameras\[1\] is not a rotation"),
    "scaled": ({"cameras": np.diag([2.0, 2.0, 2.0, 1.0])}, r"cameras\[0\] is not a rotation"),
    "reflected": ({"cameras": REFLECTED}, "is a reflection"),
    "not finite": ({"cameras": np.eye(4) * np.nan}, "not finite"),
    "text": ({"cameras": "orbit"}, "not an array of numbers"),
    "size of K": ({"intrinsics": np.eye(4)}, "intrinsics has the shape"),
    "skewed": ({"intrinsics": K + np.eye(3, k=1)}, "without skew"),
    "oblong pixels": ({"intrinsics": np.diag([70.0, 80.0, 1.0])}, "pixels are square"),
    "both": ({"fov": 40}, "give one of them"),
    "output": ({"outputs": ["dept"]}, "outputs has 'dept', .*did you mean 'depth'"),
    "nothing": ({"outputs": []}, "outputs is empty"),
    "sink": ({"sinks": ["tfrecord"]}, "sinks has 'tfrecord'"),
    "coco": ({"sinks": ["coco"]}, "needs boxes or masks"),
    "camera": ({"camera": "front"}, "for a single picture"),
    "categories": ({"categories": {"cat*": "cat"}}, "match no object"),
    "convention": ({"convention": "vulkan"}, "opengl or opencv"),
    "lens": ({"distortion": {"model": "brown", "coefficients": [-0.9]}}, "parts of the picture show nothing"),
    "lens for nerfstudio": (
        {"distortion": {"model": "brown", "coefficients": [0, 0, 0, 0, 0, 0.01]}, "outputs": ["color"], "sinks": ["transforms"]},
        "the sink transforms has no k4",
    ),
    "model of the lens": ({"distortion": {"model": "panini"}}, "distortion has the model 'panini'"),
    "format": ({"plane_format": "tiff"}, "plane_format has 'tiff'"),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_one_sentence(case: str, tmp_path: Path) -> None:
    changes, message = WRONG[case]
    with pytest.raises(RayfarmError, match=message) as caught:
        made(tmp_path / "a", **{"outputs": ["depth"], **changes})
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "a" / "manifest.jsonl").exists()


def test_a_file_describes_a_data_set(tmp_path: Path) -> None:
    own = {"seed": 3, "objects": {"*-box": {"turn": {"uniform": [0, 90]}}}}
    (tmp_path / "varied.yaml").write_text(f"{CORNELL.read_text()}\nvary: {json.dumps(own)}\n")
    document = {
        "scene": "varied.yaml",
        "folder": "made",
        "cameras": {"orbit": {"count": 2, "radius": 3}},
        "fov": 40,
        "outputs": ["depth"],
        "plane_format": "exr",
        "settings": {"width": 16, "height": 12},
    }
    path = tmp_path / "set.yaml"
    path.write_text(json.dumps(document))
    found = dataset_of_file(path)
    assert found.folder == tmp_path / "made" and [v["files"]["depth"]["path"] for v in found.views] == [
        "depth/000000.exr",
        "depth/000001.exr",
    ]
    assert found.description["vary"] == own and found.views[0]["variation"] != found.views[1]["variation"]
    path.write_text(json.dumps({**document, "folder": "still", "vary": False}))
    assert "vary" not in dataset_of_file(path).description
    (tmp_path / "varied.yaml").write_text(f"{CORNELL.read_text()}\nvary: {{objects: {{a: {{spin: 1}}}}}}\n")
    path.write_text(json.dumps({**document, "folder": "wrong", "vary": False}))
    with pytest.raises(RayfarmError, match=r"vary: is invalid: .*spin"):
        dataset_of_file(path)
    document["scene"] = str(CORNELL)
    for change, message in (
        ({"camera": {}}, "'camera' is not known; did you mean 'cameras'"),
        ({"cameras": {"orbits": {}}}, "cameras has one of the keys"),
        ({"cameras": {"orbit": {"number": 3}}}, "number"),
        ({"settings": {"sped": 1}}, "did you mean 'seed'|'sped'"),
    ):
        path.write_text(json.dumps({**document, "folder": "other", **change}))
        with pytest.raises(RayfarmError, match=message):
            dataset_of_file(path)


@pytest.mark.parametrize(
    "lens",
    [
        pytest.param({"model": "brown", "coefficients": [-0.15, 0.03, 0.001, -0.002]}, marks=pytest.mark.long),
        {"model": "fisheye", "coefficients": [-0.01, 0.002]},
    ],
)
def test_flow_of_a_distorted_lens_is_depth_and_pose_by_opencvs_formulas(lens: dict[str, Any], tmp_path: Path) -> None:
    outputs = ["depth", "position", "flow_forward"]
    found = made(tmp_path / "a", outputs, distortion=lens)
    assert found.description["distortion"] == lens
    distortion = LensDistortion(lens["model"], tuple(lens["coefficients"]))
    y, x = np.mgrid[0:48, 0:64] + 0.5
    for view, other in ((0, 0), (0, 1), (1, 2)):
        there = plane(tmp_path / "a", "position", view).astype(np.float64)
        met = np.isfinite(there[..., 0])
        pose = np.array(found.views[other]["world_to_camera_opencv"])
        inside = there[met] @ pose[:3, :3].T + pose[:3, 3]
        seen = opencv_pixels(distortion, inside, K[0, 0], (K[0, 2], K[1, 2]))
        way = seen - np.stack([x, y], -1)[met]
        if other == view:  # each point is seen in its pixel's centre, and its depth is that along the line of sight
            np.testing.assert_allclose(way, 0, atol=1e-3)
            np.testing.assert_allclose(inside[:, 2], plane(tmp_path / "a", "depth", view)[met], rtol=1e-5)
        else:
            flow = plane(tmp_path / "a", "flow_forward", view)[met]
            known = np.isfinite(flow[:, 0])
            assert known.mean() > 0.5
            np.testing.assert_allclose(flow[known], way[known], atol=1e-3)


def test_a_distortion_comes_back_from_transforms_and_colmap(tmp_path: Path) -> None:
    lens = {"model": "brown", "coefficients": [-0.1, 0.02, 0.001, 0.002]}
    view = {"files": {"color": {"path": "color/000000.png"}}, "camera_to_world_opengl": np.eye(4).tolist()}
    for name, given in (("brown", lens), ("fisheye", {"model": "fisheye", "coefficients": [0.01, 0.0, 0.0, 0.001]})):
        (tmp_path / name).mkdir()
        write_transforms(tmp_path / name, {"intrinsics": K.tolist(), "width": 64, "height": 48, "distortion": given}, [view])
        read = Cameras.from_transforms(tmp_path / name / "transforms.json").distortion
        assert read is not None and read.model == name
        assert [*read.coefficients[:4]] == given["coefficients"] and not any(read.coefficients[4:])
    of_nerfstudio = tmp_path / "brown" / "transforms.json"
    of_nerfstudio.write_text(json.dumps({**json.loads(of_nerfstudio.read_text()), "k4": 0.01}))
    with pytest.raises(SettingsError, match=r"nerfstudio's coefficient of r\^8"):
        Cameras.from_transforms(of_nerfstudio)
    (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 4 1 000.png\n\n")
    for model, numbers, expected in (
        ("OPENCV", "70 70 30.5 25.25 -0.1 0.02 0.001 0.002", lens),
        ("SIMPLE_RADIAL", "70 30.5 25.25 -0.1", {"model": "brown", "coefficients": [-0.1]}),
        ("OPENCV_FISHEYE", "70 70 30.5 25.25 0.1 0 0 0", {"model": "fisheye", "coefficients": [0.1, 0.0, 0.0, 0.0]}),
    ):
        (tmp_path / "cameras.txt").write_text(f"1 {model} 64 48 {numbers}\n")
        camera = Cameras.from_colmap(tmp_path)
        assert camera.distortion is not None and camera.distortion.to_json() == expected
        assert camera.intrinsics is not None and np.array_equal(camera.intrinsics, K)
