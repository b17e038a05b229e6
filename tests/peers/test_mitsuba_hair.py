"""Tests that fur is as bright as Mitsuba's curves with Mitsuba's hair."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from renderer.film import mean
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.scene.load import read
from renderer.settings import RenderSettings, chosen

SPP = 256
SIZE = 40
BLOCK = 8
SCENE = f"""<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="16"/></integrator>
<sensor type="perspective"><float name="fov" value="28"/>
<transform name="to_world"><lookat origin="0, 1, 6" target="0, -0.1, 0" up="0, 1, 0"/></transform>
<film type="hdrfilm"><integer name="width" value="{SIZE}"/><integer name="height" value="{SIZE}"/><rfilter type="box"/></film>
</sensor>
<emitter type="constant"><rgb name="radiance" value="0.3 0.35 0.4"/></emitter>
<emitter type="directional"><vector name="direction" value="-0.5 -0.75 -0.55"/><rgb name="irradiance" value="3"/></emitter>
<shape type="sphere"><float name="radius" value="0.99"/>
<bsdf type="diffuse"><rgb name="reflectance" value="0.2 0.12 0.1"/></bsdf></shape>
<shape type="bsplinecurve"><string name="filename" value="fur.txt"/><bsdf type="hair"><float name="eumelanin" value="0.3"/>
<float name="longitudinal_roughness" value="0.25"/><float name="azimuthal_roughness" value="0.3"/></bsdf></shape></scene>"""


def fur(count: int, radius: float) -> str:
    """Returns a file of strands on the unit sphere, which bend under their weight."""
    random = np.random.default_rng(3)
    root = random.normal(size=(count, 3))
    root /= np.linalg.norm(root, axis=1, keepdims=True)
    towards = root + 0.3 * random.normal(size=(count, 3))
    strands = [0.9 * root, root]
    for _ in range(5):
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        strands.append(strands[-1] + 0.12 * towards)
        towards = towards - np.array((0, 0.3, 0))
    radii = np.linspace(radius, radius / 4, len(strands))
    points = np.stack(strands, axis=1)
    return "\n\n".join("\n".join(f"{x} {y} {z} {r}" for (x, y, z), r in zip(each, radii, strict=True)) for each in points)


@pytest.mark.long
@pytest.mark.parametrize("count, radius", [(400, 0.02), (4000, 0.008)])
def test_fur_is_as_bright_as_mitsubas(count: int, radius: float, tmp_path: Path) -> None:
    """Whole pictures differ by at most 1.5 %, blocks of 8 x 8 pixels by 3 % on average."""
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    (tmp_path / "fur.txt").write_text(fur(count, radius))
    (tmp_path / "scene.xml").write_text(SCENE)
    theirs = np.array(mi.render(mi.load_file(str(tmp_path / "scene.xml")), spp=SPP))[..., :3]
    described = read(tmp_path, "scene.xml")
    settings = RenderSettings(SIZE, SIZE, described.cameras[0].view, **chosen({}, described.defaults))
    ours = mean(render_frame(compile_scene(described), settings, SPP), settings.film_exponent)
    np.testing.assert_allclose(ours.mean((0, 1)), theirs.mean((0, 1)), rtol=0.015)
    blocks = [each.reshape(SIZE // BLOCK, BLOCK, SIZE // BLOCK, BLOCK, 3).mean((1, 3)) for each in (ours, theirs)]
    difference = float(np.abs(blocks[0] - blocks[1]).mean() / blocks[1].mean())
    print(f"means differ by {ours.mean() / theirs.mean() - 1:.2%}, blocks by {difference:.2%}")
    assert difference < 0.03
