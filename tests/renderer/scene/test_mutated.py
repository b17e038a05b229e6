"""Tests of glTF files of another program with mutated JSON that is still valid: each is read, or refused by the reader itself."""

import json
import struct

import numpy as np

from renderer.errors import SceneError
from renderer.scene.animation import Moment
from renderer.scene.compile import compile_scene
from renderer.scene.load import read
from tests.grids import grid
from tests.renderer.scene.builders import full_gltf, moving_gltf
from tests.renderer.scene.finite import is_finite

ODD = [None, True, -1, 0, 1, 7, 255, 5126, 2**31, 2**63, 1e-40, 1e39, float("nan"), "", "a", [], {}, [0], [[1, 2]], {"a": 1}]
FILES = {"toy.glb": 120, "modes.glb": 120, "full": 120, "moving": 120}  # files and the number of mutations of each


def chunks(glb):
    """Returns the JSON and the binary chunk of a GLB."""
    length = struct.unpack_from("<I", glb, 12)[0]
    return json.loads(glb[20 : 20 + length]), glb[20 + length + 8 :]


def packed(root, binary):
    text = json.dumps(root).encode()
    text += b" " * (-len(text) % 4)
    parts = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(parts)) + parts


def places(value):
    """Returns (container, key) of all nested values."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, child in list(items):
        yield value, key
        yield from places(child)


def mutated(root, rng):
    """Returns the JSON with one to three mutations: an odd value, a part moved elsewhere, a part removed, or a list repeated."""
    root = json.loads(json.dumps(root))
    for _ in range(rng.integers(1, 4)):
        everything = list(places(root))
        parent, key = everything[rng.integers(len(everything))]
        other, from_ = everything[rng.integers(len(everything))]
        way = rng.integers(4)
        if way == 0:
            parent[key] = ODD[rng.integers(len(ODD))]
        elif way == 1:
            parent[key] = json.loads(json.dumps(other[from_]))
        elif way == 2:
            del parent[key]
        elif isinstance(parent[key], list):
            parent[key] = parent[key] * 2
    return root


@grid("file", FILES, ordinary=("full",))
def test_mutated_glb_is_read_or_rejected(samples, tmp_path, png, file):
    root, binary = chunks(sample(samples, png, file))
    rng = np.random.default_rng(11)
    told = 0
    for _ in range(FILES[file]):
        (tmp_path / "a.glb").write_bytes(packed(mutated(root, rng), binary))
        try:
            description = read(tmp_path, "a.glb", moment=Moment(8))
        except SceneError as error:
            told += 1
            assert str(error).startswith(("a.glb: ", "a.glb "))
            assert "could not be read as" not in str(error), "the backstop spoke: a reader let a value through unchecked"
        else:
            assert all(np.isfinite(i.transform).all() for i in description.instances)
            assert all(m.triangles.max(initial=-1) < len(m.positions) for m in description.meshes)
            if file == "full":
                assert_compiles_or_fails(description)
    assert 0 < told / FILES[file] < 0.9  # some mutations are refused; most only cost a part of the scene


def sample(samples, png, file):
    """Returns the bytes of the unmodified file that is named `file` in FILES."""
    made = {"full": full_gltf, "moving": moving_gltf}.get(file)
    return made(png).glb() if made else (samples / file).read_bytes()


def assert_compiles_or_fails(description):
    """Asserts that the description compiles into finite numbers, or is rejected with a SceneError."""
    try:
        scene = compile_scene(description)
    except SceneError as error:
        assert len(str(error)) > 20
    else:
        assert is_finite(scene)


@grid("file", FILES, ordinary=("moving",))
def test_glb_with_damaged_numbers_is_read_or_rejected(samples, tmp_path, png, file):
    root, binary = chunks(sample(samples, png, file))
    rng = np.random.default_rng(12)
    for _ in range(25):
        damaged = np.frombuffer(binary, np.uint8).copy()
        at = rng.integers(len(damaged), size=max(len(damaged) // 200, 4))
        damaged[at] = rng.integers(256, size=len(at))
        (tmp_path / "a.glb").write_bytes(packed(root, damaged.tobytes()))
        try:
            description = read(tmp_path, "a.glb", moment=Moment(8))
        except SceneError as error:
            assert str(error).startswith(("a.glb: ", "a.glb "))
            assert "could not be read as" not in str(error)
        else:
            assert all(np.isfinite(m.positions).all() for m in description.meshes)
