"""Tests of compiled scenes in files: identical bits, memory-mapped, and validated before use."""

import json
import mmap

import numpy as np
import pytest

from renderer.arrays.rows import ABOVE, PART_MATERIAL, PART_SHINES
from renderer.arrays.scene import LAYOUT, flat
from renderer.errors import SceneError
from renderer.film import digest
from renderer.render import render_frame
from renderer.scene.compiled import load, save, seal
from renderer.scene.description import Image, Instance, Material, SceneDescription, Sphere, Texture
from tests.renderer.builders import box, emitter, gray, scene, settings, square


@pytest.fixture(scope="module")
def made():
    sky = np.random.default_rng(1).gamma(1.0, size=(4, 8, 3)).astype(np.float32)
    meshes = (square((0, 0, 0), (5, 0, 0), (0, 0, -5), 0), box(1, 0.5, (0, 1, 0)))
    return scene([Material(base_color=gray(0.6)), emitter(2.0)], meshes, (Sphere((1, 1, 1), 0.3, 0),), environment=sky)


@pytest.fixture
def path(made, tmp_path):
    save(made, tmp_path / "scene.rayfarm")
    return tmp_path / "scene.rayfarm"


def test_loaded_scene_equals_the_saved_one(made, path):
    loaded = load(path)
    for name, array in flat(made).items():
        again = flat(loaded)[name]
        assert again.dtype == array.dtype
        assert again.shape == array.shape
        assert again.tobytes() == array.tobytes()
    asked = settings((0, 2, 6), (0, 1, 0), 40)
    assert digest(render_frame(loaded, asked, 2)) == digest(render_frame(made, asked, 2))


def test_saving_is_reproducible_and_leaves_one_file(made, path):
    again = path.with_name("again")
    save(load(path), again)
    assert again.read_bytes() == path.read_bytes()
    assert sorted(p.name for p in path.parent.iterdir()) == ["again", "scene.rayfarm"]


def test_arrays_are_read_only_aligned_views_of_one_mapping(path):
    mapping = set()
    for name, array in flat(load(path)).items():
        assert not array.flags.writeable, name
        with pytest.raises(ValueError, match="read-only"):
            array.reshape(-1)[:] = 0
        with pytest.raises(ValueError, match="cannot set WRITEABLE"):
            array.flags.writeable = True
        base = array
        while isinstance(base, np.ndarray):
            base = base.base
        base = base.obj if isinstance(base, memoryview) else base
        assert isinstance(base, mmap.mmap)
        mapping.add(id(base))
        assert array.ctypes.data % array.dtype.itemsize == 0
    assert len(mapping) == 1
    assert flat(load(path))["bvh.node"].ctypes.data % 64 == 0


def test_the_file_is_a_safetensors_file(made, path):
    numpy_reader = pytest.importorskip("safetensors.numpy")
    arrays = numpy_reader.load_file(path)
    assert set(arrays) == set(LAYOUT)
    np.testing.assert_array_equal(arrays["position"], made.position)


def test_truncated_file_is_rejected(path):
    data = path.read_bytes()
    header = 8 + int.from_bytes(data[:8], "little")
    for length in {0, 1, 7, 8, 9, 100, header - 1, header, header + 1, len(data) // 2, len(data) - 1}:
        path.write_bytes(data[:length])
        with pytest.raises(SceneError, match=r"scene\.rayfarm"):
            load(path)


def test_file_with_extra_bytes_is_rejected(path):
    path.write_bytes(path.read_bytes() + b"\0")
    with pytest.raises(
        SceneError, match=r"scene\.rayfarm is damaged or not a compiled scene: it is longer than the sum of its arrays"
    ):
        load(path)


def rewritten(path, change):
    """Rewrites a compiled scene's file with its header changed by the function `change`."""
    data = path.read_bytes()
    length = int.from_bytes(data[:8], "little")
    header = json.loads(data[8 : 8 + length])
    header = change(header) or header
    text = json.dumps(header).encode()
    text += b" " * (-(8 + len(text)) % 64)
    path.write_bytes(len(text).to_bytes(8, "little") + text + data[8 + length :])


WRONG_HEADERS = {
    "another version": lambda h: h["__metadata__"].update(version="999"),
    "another format": lambda h: h.update(__metadata__={"format": "pt"}),
    "no metadata": lambda h: h.pop("__metadata__") and None,
    "a missing array": lambda h: h.pop("uv") and None,
    "an array too many": lambda h: h.update(extra={"dtype": "F32", "shape": [0], "data_offsets": [0, 0]}),
    "another type": lambda h: h["normal"].update(dtype="F64"),
    "a shape that is too large": lambda h: h["normal"].update(shape=[10**12, 3]),
    "a shape that overflows": lambda h: h["normal"].update(shape=[2**62, 2**62]),
    "a negative shape": lambda h: h["normal"].update(shape=[-1, -3]),
    "a shape that is no list": lambda h: h["normal"].update(shape="wide"),
    "offsets elsewhere": lambda h: h["normal"].update(data_offsets=[0, h["normal"]["data_offsets"][1]]),
    "offsets that are no numbers": lambda h: h["normal"].update(data_offsets=["a", "b"]),
    "an entry that is none": lambda h: h.update(normal=None),
    "a list": lambda h: ["a list"],
}


@pytest.mark.parametrize("fault", WRONG_HEADERS)
def test_a_wrong_header_is_refused(path, fault):
    rewritten(path, WRONG_HEADERS[fault])
    with pytest.raises(SceneError, match="is damaged or not a compiled scene"):
        load(path)


def test_invalid_header_and_non_scene_file_are_rejected(path):
    data = bytearray(path.read_bytes())
    data[8:20] = b"not json...."
    path.write_bytes(data)
    with pytest.raises(SceneError, match="is damaged or not a compiled scene"):
        load(path)
    for junk in (b"\x89PNG\r\n\x1a\n" + bytes(100), b"\xff" * 100, bytes(100)):
        path.write_bytes(junk)
        with pytest.raises(SceneError, match="header"):
            load(path)


def test_missing_file_raises_os_error(tmp_path):
    with pytest.raises(FileNotFoundError):
        load(tmp_path / "nothing")


@pytest.mark.parametrize("name", ["triangle", "triangle_light", "sphere_material", "sphere_light", "light_primitive"])
def test_index_out_of_range_is_rejected(made, tmp_path, name):
    """An index out of range is refused, since kernels do not check indices and would crash."""
    for value in (10**6, -2):
        array = getattr(made, name).copy()
        array.reshape(-1)[-1] = value
        save(made._replace(**{name: array}), tmp_path / "bad")
        with pytest.raises(SceneError, match=name):
            load(tmp_path / "bad")


@pytest.mark.parametrize(("name", "column"), [("triangle", 3), ("part", PART_MATERIAL)])
def test_missing_part_is_rejected(made, tmp_path, name, column):
    for value in (10**6, -1):
        array = getattr(made, name).copy()
        array[-1, column] = value
        save(made._replace(**{name: array}), tmp_path / "bad")
        with pytest.raises(SceneError, match="part"):
            load(tmp_path / "bad")


def test_emissive_part_must_have_lights(made, tmp_path):
    part = made.part.copy()
    part[:, PART_SHINES] = 1
    save(made._replace(part=part, triangle_light=made.triangle_light[:0]), tmp_path / "bad")
    with pytest.raises(SceneError, match="emits light"):
        load(tmp_path / "bad")


def test_bvh_index_out_of_range_is_rejected(made, tmp_path):
    for field, row, value in (("node", 6, 10**6), ("node", 6, -(10**6)), ("packet", 9, 10**6), ("packet", 9, -1)):
        array = getattr(made.bvh, field).copy()
        array[0, row].view(np.int32)[0] = value
        save(made._replace(bvh=made.bvh._replace(**{field: array})), tmp_path / "bad")
        with pytest.raises(SceneError, match="BVH"):
            load(tmp_path / "bad")


def test_texture_beyond_the_texels_is_rejected(tmp_path):
    pixels = np.full((2, 2, 4), 255, np.uint8)
    from renderer.scene.compile import compile_scene

    textured = compile_scene(
        SceneDescription(
            meshes=[box(0)],
            instances=[Instance(0)],
            materials=[Material(base_color_texture=0)],
            textures=[Texture(0)],
            images=[Image("four", pixels)],
        )
    )
    save(textured, tmp_path / "good")
    load(tmp_path / "good")
    save(textured._replace(uv=textured.uv[:0]), tmp_path / "bad")
    with pytest.raises(SceneError, match="coordinates"):
        load(tmp_path / "bad")
    texture = textured.texture.copy()
    texture[0, 0] = 1
    save(textured._replace(texture=texture), tmp_path / "bad")
    with pytest.raises(SceneError, match="texel"):
        load(tmp_path / "bad")
    texture = textured.texture.copy()
    texture[0, ABOVE] = 0  # a texture layered on itself would never end
    save(textured._replace(texture=texture), tmp_path / "bad")
    with pytest.raises(SceneError, match="layer"):
        load(tmp_path / "bad")


def test_inconsistent_arrays_are_rejected_before_saving(made):
    with pytest.raises(SceneError, match="sphere_material"):
        seal(made._replace(sphere_material=np.zeros(7, np.int32)))


def test_failed_save_keeps_the_old_file(made, path):
    before = path.read_bytes()

    class Broken:
        nbytes = 4

    with pytest.raises((AttributeError, TypeError, ValueError)):
        save(made._replace(bounds=Broken()), path)
    assert path.read_bytes() == before
    assert [p.name for p in path.parent.iterdir()] == [path.name]
