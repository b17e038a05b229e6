"""Tests of density grids in scene files: reading, bounds of the cells, and errors for unsuitable files."""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from renderer.arrays.kernel_variant import variant_of
from renderer.errors import SceneError
from renderer.scene.compile import compile_scene
from renderer.scene.description import Material, Medium, SceneDescription, Sphere, Volume
from renderer.scene.load import read
from renderer.scene.readers.volume_files import read_volume
from renderer.scene.volumes import tabulate_volumes
from tests.grids import grid

GRID = np.arange(24, dtype=np.float32).reshape(2, 3, 4)  # x, y, z


def npy(values: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, values)
    return stream.getvalue()


def vol(values: np.ndarray, version: int = 3, encoding: int = 1, channels: int = 1) -> bytes:
    nz, ny, nx = values.shape
    header = b"VOL" + bytes([version]) + struct.pack("<5i6f", encoding, nx, ny, nz, channels, 0, 0, 0, 1, 1, 1)
    return header + values.tobytes()


@pytest.mark.parametrize("kind", [np.float32, np.float64, np.float16, np.uint8, ">f4"])
def test_a_numpy_file_is_indexed_x_y_z(kind: Any) -> None:
    for values in (GRID.astype(kind), np.asfortranarray(GRID.astype(kind))):
        found = read_volume(npy(values), "a.npy")
        assert found.dtype == np.float32
        assert found.flags.c_contiguous
        np.testing.assert_array_equal(found, GRID.transpose(2, 1, 0))


def test_a_mitsuba_volume_has_x_as_its_fastest_axis() -> None:
    values = GRID.transpose(2, 1, 0).copy()
    np.testing.assert_array_equal(read_volume(vol(values), "a.vol"), values)
    codes = np.arange(24, dtype=np.uint8).reshape(4, 3, 2)
    np.testing.assert_allclose(read_volume(vol(codes, encoding=3), "a.vol"), codes / 255)


WRONG = {
    "no volume": (b"P6 1 1", "is not a volume"),
    "truncated": (npy(GRID)[:-1], "damaged"),
    "longer": (npy(GRID) + b"0", "damaged"),
    "no header": (npy(GRID)[:20], "damaged"),
    "two axes": (npy(GRID[0]), "float32 of the shape 3, 4;"),
    "an empty axis": (npy(GRID[:0]), "three axes"),
    "complex": (npy(GRID.astype(complex)), "complex128"),
    "objects": (npy(np.full((1, 1, 1), None)), "object"),
    "a vol of colours": (vol(np.zeros((1, 1, 3), np.float32), channels=3), "3 channels"),
    "a vol of version 2": (vol(np.zeros((1, 1, 3), np.float32), version=2), "version 2"),
    "a truncated vol": (vol(np.zeros((1, 1, 3), np.float32))[:-2], "damaged"),
    "a vol's header": (b"VOL\x03", "damaged"),
    "a huge vol": (b"VOL\x03" + struct.pack("<5i6f", 1, 2000, 2000, 2000, 1, 0, 0, 0, 1, 1, 1), "8000000000 voxels"),
}


@grid("name", WRONG, ordinary=tuple(WRONG))
def test_unsuitable_files_are_refused_with_a_sentence(name: str) -> None:
    data, sentence = WRONG[name]
    with pytest.raises(SceneError, match=sentence):
        read_volume(data, "a.npy")


def test_a_header_that_claims_more_than_there_is() -> None:
    head = b"{'descr': '<f4', 'fortran_order': False, 'shape': (2000, 2000, 2000), }"
    data = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head
    with pytest.raises(SceneError, match="8000000000 voxels"):
        read_volume(data, "a.npy")


SCENE = """
volumes:
  plume: {density: plume.npy, bounds: [[-1, 0, -1], [1, 3, 1]], emission: fire.npy, emission_color: [3, 2, 1],
          transform: [{translate: [0, 1, 0]}]}
materials:
  smoke: {kind: interface, sigma_s: 2, volume: plume}
medium: {sigma_s: 0.1, volume: plume}
shapes:
  - {type: cube, material: smoke}
"""


def written(folder: Path, text: str = SCENE, **grids: np.ndarray) -> Path:
    (folder / "s.yaml").write_text(text)
    for name, values in {"plume": GRID, "fire": GRID, **grids}.items():
        np.save(folder / f"{name}.npy", values)
    return folder


def test_a_scene_file_names_the_grids_of_its_media(tmp_path: Path) -> None:
    found = read(written(tmp_path), "s.yaml")
    plume = found.volumes["plume"]
    np.testing.assert_array_equal(plume.density, GRID.transpose(2, 1, 0))
    np.testing.assert_allclose(plume.to_world, [[2, 0, 0, -1], [0, 3, 0, 1], [0, 0, 2, -1], [0, 0, 0, 1]])
    assert plume.emission is not None
    assert plume.emission_color == (3, 2, 1)
    assert (found.materials[0].volume, found.medium) == ("plume", Medium(sigma_s=(0.1, 0.1, 0.1), volume="plume"))
    compiled = compile_scene(found)
    assert variant_of(compiled) == "grids"
    assert compiled.volume_grid.tolist() == [[2, 3, 4, 0, 24, 1, 1, 1, 0]]


BAD = {
    "a missing file": (SCENE.replace("plume.npy", "gone.npy"), {}, r"line 3.*gone\.npy is not among"),
    "a damaged file": (SCENE.replace("plume.npy", "s.yaml"), {}, r"line 3.*is not a volume"),
    "bounds without extent": (SCENE.replace("[1, 3, 1]", "[1, 0, 1]"), {}, "second corner"),
    "an unknown volume": (SCENE.replace("volume: plume}\nmedium", "volume: fog}\nmedium"), {}, "no volume fog; known are"),
    "a negative density": (SCENE, {"plume": GRID - 1}, "values from -1 to 22; they must be from 0"),
    "NaN": (SCENE, {"plume": np.full((2, 3, 4), np.nan)}, "density has values from nan"),
    "another shape": (SCENE, {"fire": GRID[:, :2]}, "2, 2, 4, its density 2, 3, 4;"),
    "a flat transform": (SCENE.replace("translate: [0, 1, 0]", "scale: [1, 0, 1]"), {}, "no extent"),
    "a field too many": (SCENE.replace("bounds", "limits"), {}, "limits"),
}


@grid("name", BAD, ordinary=tuple(BAD))
def test_what_is_wrong_with_a_volume_is_said(name: str, tmp_path: Path) -> None:
    text, grids, sentence = BAD[name]
    with pytest.raises(SceneError, match=f"(?s){sentence}"):
        compile_scene(read(written(tmp_path, text, **grids), "s.yaml"))


def test_cells_bound_what_is_interpolated_in_them() -> None:
    """The largest of many interpolated values in each cell is at most its bound, and the bound is some voxel's value nearby."""
    random = np.random.default_rng(3)
    density = (random.random((13, 10, 21)) * np.linspace(0, 1, 21)).astype(np.float32)
    described = SceneDescription(
        materials=[Material(kind="interface", sigma_s=(1.0, 1.0, 1.0), volume="a")],
        spheres=[Sphere((0.0, 0.0, 0.0), 1.0)],
        volumes={"a": Volume(density, np.eye(4))},
    )
    tables = tabulate_volumes(described)
    cells = tables.volume_grid[0, 5:8][::-1]
    bounds = tables.majorant[:, 0].reshape(cells)
    points = random.random((200_000, 3))
    at = np.clip(points * density.shape - 0.5, 0, np.array(density.shape) - 1)
    low = np.minimum(at.astype(int), np.array(density.shape) - 2)
    share = at - low
    values = np.zeros(len(points))
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(corner, share, 1 - share), axis=1)
        values += weight * density[tuple((low + corner).T)]
    assert (values <= bounds[tuple((points * cells).astype(int).T)]).all()
    assert bounds.mean() < 0.8


def test_only_volumes_that_are_used_are_compiled() -> None:
    place, ones = np.eye(4), np.ones((2, 2, 2), np.float32)
    fog = Material(kind="interface", sigma_s=(1.0, 1.0, 1.0))
    described = SceneDescription(
        materials=[fog], spheres=[Sphere((0.0, 0.0, 0.0), 1.0)], volumes={"a": Volume(ones, place), "b": Volume(ones, place)}
    )
    assert len(compile_scene(described).volume) == 0
    described.medium = Medium(sigma_a=(1.0, 1.0, 1.0), volume="b")
    assert len(compile_scene(described).volume) == 1
