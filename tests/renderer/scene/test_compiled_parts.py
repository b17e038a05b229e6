"""Tests of compiled scenes stored in several files (parts).

All arrays are restored, parts that scenes share are written once, and damage is detected.
"""

import json

import numpy as np
import pytest

from renderer.arrays.scene import flat
from renderer.bvh.layout import PAGE
from renderer.errors import SceneError
from renderer.scene import compiled_parts as parts_file
from renderer.scene.compile import compile_scene
from renderer.scene.compiled import load
from renderer.scene.compiled_parts import Saver, parts_of
from renderer.scene.frame_reuse import ShotCache
from tests.renderer.scene.test_shutter_merge import zoo


def same(ours, theirs):
    for (name, a), b in zip(flat(ours).items(), flat(theirs).values(), strict=True):
        np.testing.assert_array_equal(a, b, err_msg=name)
        assert a.dtype == b.dtype
        assert not a.flags.writeable
        assert a.ctypes.data % 8 == 0


@pytest.fixture(params=["mapped", "copied"])
def way(request, monkeypatch):
    """Runs the test twice: with a scene's parts mapped into one memory area, and with parts copied into it.

    Parts can be mapped on systems with memory pages of 4 KiB, and are copied on others.
    """
    if request.param == "copied":
        monkeypatch.setattr(parts_file, "_maps_over", None)


@pytest.mark.usefixtures("way")
def test_frames_round_trip_and_share_static_parts(tmp_path):
    kept, saver = ShotCache(), Saver(tmp_path)
    manifests, scenes = [], []
    for angle in (0.0, 20.0, 33.0):
        compiled = compile_scene(zoo(angle), shot_cache=kept)
        manifests.append(saver.save(compiled, kept.cuts))
        scenes.append(load(manifests[-1]))
        same(scenes[-1], compiled)
    for angle, scene in zip((0.0, 20.0, 33.0), scenes, strict=True):  # earlier scenes are unchanged after later ones were saved
        same(scene, compile_scene(zoo(angle)))
    named = [{part.sha256 for part in parts_of(manifest)} for manifest in manifests]
    shared = set.intersection(*named)
    sizes = {part.sha256: part.size for manifest in manifests for part in parts_of(manifest)}
    assert len(shared) >= 5  # static geometry, bodies, topology of deforming meshes, materials, environment, ...
    assert all((tmp_path / sha256).stat().st_size == size for sha256, size in sizes.items())
    of_zoo = sum(array.nbytes for array in flat(scenes[0]).values())
    assert sum(sizes[s] for s in named[1] - shared) < 0.5 * of_zoo
    assert sum(sizes[s] for s in shared) > 0.5 * of_zoo


def test_frame_saved_alone_has_the_same_parts(tmp_path):
    kept, saver = ShotCache(), Saver(tmp_path)
    names = []
    for angle in (0.0, 33.0):
        names.append(saver.save(compile_scene(zoo(angle), shot_cache=kept), kept.cuts).name)
    alone = ShotCache()
    assert Saver(tmp_path).save(compile_scene(zoo(33.0), shot_cache=alone), alone.cuts).name == names[1] != names[0]


def test_unchanged_parts_are_not_written_again(tmp_path, monkeypatch):
    written = []
    known = parts_file._write_part
    monkeypatch.setattr(parts_file, "_write_part", lambda slices, folder: written.append(set(slices)) or known(slices, folder))
    kept, saver = ShotCache(), Saver(tmp_path)
    for angle in (0.0, 33.0):
        written.clear()
        saver.save(compile_scene(zoo(angle), shot_cache=kept), kept.cuts)
    assert not any("texel" in names or "environment" in names or "material" in names for names in written)
    assert sum("bvh.packet" in names for names in written) == 1  # that of the loose part


def test_static_scene_can_be_saved_in_parts(tmp_path):
    kept = ShotCache()
    compiled = compile_scene(zoo(marked=False), shot_cache=kept)
    same(load(Saver(tmp_path).save(compiled, kept.cuts)), compiled)


def saved(folder):
    kept = ShotCache()
    return Saver(folder).save(compile_scene(zoo(), shot_cache=kept), kept.cuts)


@pytest.mark.parametrize(
    "spoil",
    [
        lambda m: m.update(format="another"),
        lambda m: m.pop("parts"),
        lambda m: m["parts"].pop(),
        lambda m: m["parts"][0].__setitem__(1, 1 << 50),
        lambda m: m["arrays"].pop("position"),
        lambda m: m["arrays"]["position"].update(shape=[1, 3]),
        lambda m: m["arrays"]["position"].update(shape=[-1, -3]),
        lambda m: m["arrays"]["position"]["pieces"].pop(),
        lambda m: m["arrays"]["position"]["pieces"][0].__setitem__(1, 8),
        lambda m: m["arrays"]["position"]["pieces"][0].__setitem__(0, 99),
        lambda m: m["arrays"]["bvh.node"]["pieces"].reverse(),
        lambda m: m["arrays"]["triangle"]["pieces"].__setitem__(0, m["arrays"]["bvh.packet"]["pieces"][0]),
    ],
)
def test_damaged_manifest_is_an_error(tmp_path, spoil):
    path = saved(tmp_path)
    manifest = json.loads(path.read_bytes())
    spoil(manifest)
    path.write_text(json.dumps(manifest))
    with pytest.raises(SceneError, match="is damaged or not a compiled scene"):
        load(path)


@pytest.mark.parametrize("cut", [0, PAGE, -1])
def test_truncated_part_is_an_error(tmp_path, cut):
    path = saved(tmp_path)
    part = tmp_path / max(parts_of(path), key=lambda part: part.size).sha256
    part.write_bytes(part.read_bytes()[:cut])
    with pytest.raises(
        SceneError,
        match="one of its parts has the wrong size",
    ):
        load(path)


def test_part_with_index_out_of_range_is_an_error(tmp_path):
    path = saved(tmp_path)
    part = tmp_path / max(parts_of(path), key=lambda part: part.size).sha256
    data = bytearray(part.read_bytes())
    data[6 * 32 : 7 * 32] = b"\x7f" * 32  # the children of the part's first node
    part.write_bytes(data)
    manifest = json.loads(path.read_bytes())
    for entry in manifest["parts"]:  # under a new name, since parts already verified are not verified again
        if entry[0] == part.name:
            entry[0] = "0" * 64
    part.rename(tmp_path / ("0" * 64))
    path.write_text(json.dumps(manifest))
    with pytest.raises(SceneError, match="the BVH points outside"):
        load(path)
