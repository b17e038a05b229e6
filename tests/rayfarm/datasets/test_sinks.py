"""Tests of the sinks HDF5, BOP and Parquet, each read by the format's own library or from its description."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import rayfarm
from rayfarm import Cameras, Dataset
from renderer.errors import SettingsError
from tests.rayfarm.datasets.test_datasets import CORNELL, SMALL, K, plane

CAMERAS = Cameras.sample(3, seed=4, radius=3.6, azimuth={"uniform": [-110, -70]}, elevation={"uniform": [-5, 20]})
VARY = {"seed": 2, "objects": {"*-box": {"move": {"uniform": [[-0.2, 0, 0], [0.2, 0, 0.3]]}, "turn": {"uniform": [0, 360]}}}}
OUTPUTS = ["depth", "normal_camera", "instance", "category", "masks"]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    packages = {"hdf5": "h5py", "parquet": "pyarrow"}
    sinks = ["bop", *(name for name, package in packages.items() if importlib.util.find_spec(package) is not None)]
    given: dict[str, Any] = {"intrinsics": K, "outputs": OUTPUTS, "sinks": sinks, "vary": VARY, **SMALL}
    return rayfarm.dataset(CORNELL, CAMERAS, folder=tmp_path_factory.mktemp("sinks"), **given)


def test_hdf5_has_the_planes_under_the_names_of_blenderproc(made: Dataset) -> None:
    h5py = pytest.importorskip("h5py")
    for view in range(3):
        with h5py.File(made.folder / "hdf5" / f"{view}.hdf5") as file:
            np.testing.assert_array_equal(file["depth"], plane(made.folder, "depth", view))
            np.testing.assert_array_equal(file["instance_segmaps"], plane(made.folder, "instance", view))
            np.testing.assert_array_equal(file["category_id_segmaps"], plane(made.folder, "category", view))
            np.testing.assert_allclose(2 * file["normals"][()] - 1, plane(made.folder, "normal_camera", view), atol=1e-6)
            named = {each["idx"]: each["name"] for each in json.loads(file["instance_attribute_maps"][()])}
            assert {named[n] for n in np.unique(file["instance_segmaps"]).tolist() if n} >= {"floor", "back", "large-box"}
            (camera,) = json.loads(file["campose"][()])
            assert camera["cam2world_matrix"] == CAMERAS.poses[view].tolist() and camera["cam_K"] == K.tolist()


def test_bop_poses_place_an_objects_model_on_its_depth(made: Dataset) -> None:
    """The same model of each box, known from the scene file, lies on the depth inside its mask, in every view."""
    scene = made.folder / "bop" / "train" / "000000"
    truth, cameras, infos = (
        json.loads((scene / f"{name}.json").read_text()) for name in ("scene_gt", "scene_camera", "scene_gt_info")
    )
    number = made.description["objects"].index("large-box") + 1
    places = []
    for view in range(3):
        camera = cameras[str(view)]
        depth = np.asarray(Image.open(scene / "depth" / f"{view:06}.png")) * camera["depth_scale"]
        met = np.isfinite(plane(made.folder, "depth", view))
        assert np.abs(depth[met] - 1000 * plane(made.folder, "depth", view)[met]).max() <= 0.51 * camera["depth_scale"]
        (n,) = (n for n, each in enumerate(truth[str(view)]) if each["obj_id"] == number)
        pose, info = truth[str(view)][n], infos[str(view)][n]
        whole, visible = (np.asarray(Image.open(scene / name / f"{view:06}_{n:06}.png")) > 0 for name in ("mask", "mask_visib"))
        assert visible.sum() == info["px_count_visib"] and whole.sum() == info["px_count_all"] and (whole | ~visible).all()
        k = np.array(camera["cam_K"]).reshape(3, 3)
        y, x = np.nonzero(visible)
        seen = np.linalg.inv(k) @ np.stack([x, y, np.ones(len(x))]) * depth[visible]  # OpenCV's pixels: centres at whole numbers
        rotation, place = np.array(pose["cam_R_m2c"]).reshape(3, 3), np.array(pose["cam_t_m2c"])
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
        of_model = np.abs(rotation.T @ (seen - place[:, None])) / (1000 * np.array([0.3, 0.61, 0.3])[:, None])  # a cube of side 2
        assert np.abs(of_model.max(axis=0) - 1).max() < 0.01
        places.append(place)
    assert np.ptp(places, axis=0).max() > 50


def test_parquet_has_the_manifest(made: Dataset) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    table = parquet.read_table(made.folder / "manifest.parquet")
    assert table.column("view").to_pylist() == [0, 1, 2]
    assert table.column("digest").to_pylist() == made.digests
    np.testing.assert_array_equal(np.array(table.column("camera_to_world_opengl").to_pylist()).reshape(3, 4, 4), CAMERAS.poses)
    assert table.column("depth_sha256").to_pylist() == [view["files"]["depth"]["sha256"] for view in made.views]
    assert [json.loads(each) for each in table.column("variation").to_pylist()] == [view["variation"] for view in made.views]
    assert json.loads(table.schema.metadata[b"dataset"]) == made.description


def test_a_sink_that_misses_something_is_refused_before_rendering(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def given(**more: Any) -> None:
        rayfarm.dataset(CORNELL, CAMERAS, folder=tmp_path / "a", intrinsics=K, **SMALL, **more)

    with pytest.raises(SettingsError, match="the sink bop needs masks among outputs"):
        given(outputs=["depth"], sinks=["bop"])
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(SettingsError, match=r'the sink hdf5 needs the package h5py: pip install "rayfarm\[datasets\]"'):
        given(outputs=["depth"], sinks=["hdf5"])
