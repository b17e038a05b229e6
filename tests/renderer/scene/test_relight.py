"""Tests of changing the light of a compiled scene: its files equal those of a new compilation, and shared ones are kept."""

import numpy as np

from protocol.mesh import decode_light
from renderer.image import rgbe9995
from renderer.scene.compile import compile_scene
from renderer.scene.compiled import load
from renderer.scene.compiled_parts import Saver, parts_of, save_changed
from renderer.scene.frame_reuse import ShotCache
from renderer.scene.load import read
from renderer.scene.preview import preview
from renderer.scene.relight import CHANGED_ARRAYS, replace_environment
from tests.grids import grid
from worker.reading.prepare import PREVIEW
from worker.reading.relight import save_relit

SCENE = """
lights: [{type: point, position: [1, 3, 1], color: 20}]
shapes:
  - {type: sphere, center: [0, 0.5, 0], radius: 0.5}
  - {type: cube}
"""
NO_LIGHT = SCENE.split("\n", 2)[2]


def compiled(folder, environment, out):
    kept = ShotCache()
    out.mkdir()
    scene = compile_scene(read(folder, "scene.yaml", environment), shot_cache=kept)
    return scene, Saver(out).save(scene, kept.cuts), kept.lights_power


@grid("text", [SCENE, NO_LIGHT], ids=["lamp", "nothing"])
def test_relit_scene_equals_a_new_compilation(tmp_path, text):
    (tmp_path / "scene.yaml").write_text(text)
    base, manifest, power = compiled(tmp_path, None, tmp_path / "base")
    before = {part.sha256 for part in parts_of(manifest)}
    for name in ("sky:20,30", "studio", "even-white"):
        _, whole, _ = compiled(tmp_path, name, tmp_path / f"whole-{name}")
        light = read(tmp_path, "scene.yaml", name)
        out = tmp_path / f"swapped-{name}"
        out.mkdir()
        swapped = save_changed(manifest.read_bytes(), replace_environment(base, light, power), CHANGED_ARRAYS, out)
        assert swapped.read_bytes() == whole.read_bytes()
        made = {part.sha256 for part in parts_of(swapped)} - before
        assert made == {path.name for path in out.iterdir()} - {swapped.name}
        assert len(made) == 2
        load(swapped, lambda sha256, size, out=out: next(p for p in (out / sha256, tmp_path / "base" / sha256) if p.exists()))


def test_relit_scene_has_the_light_of_a_new_preview(tmp_path):
    (tmp_path / "scene.yaml").write_text(SCENE)
    base, manifest, power = compiled(tmp_path, None, tmp_path / "base")
    new = preview(read(tmp_path, "scene.yaml", "sky:20,30"))
    save_relit(tmp_path, "sky:20,30", base, manifest.read_bytes(), power, tmp_path)
    head, words, lamps = decode_light([(tmp_path / PREVIEW).read_bytes()])
    texels = rgbe9995.unpack(np.frombuffer(words, "<u4").reshape(head.height, head.width))
    np.testing.assert_allclose(texels, new.environment, rtol=0.01, atol=1e-3 * new.environment.max())
    sun = next(lamp for lamp in new.lamps if lamp.far)
    assert [(tuple(lamp["at"]), tuple(lamp["color"])) for lamp in lamps] == [(sun.at, sun.color)]
