"""Tests of pbrt cameras that mirror: the picture is flipped, and the left-handed world need not be mirrored by our reader."""

import io

import numpy as np
import pytest
from PIL import Image

from renderer.film import mean
from renderer.render import render_frame
from renderer.scene.compile import compile_scene
from renderer.settings import RenderSettings, chosen
from tests.renderer.scene.pbrt_files import HEAD, SQUARE, world

INSIDE = f"""LightSource "infinite" "rgb L" [.2 .2 .3]
LightSource "distant" "point3 from" [2 1 2] "point3 to" [0 0 0] "rgb L" [2 2 2]
AttributeBegin Translate .3 .8 1 Rotate 60 1 .3 0
AreaLightSource "diffuse" "rgb L" [5 4 3] Shape "disk" "float radius" .3 AttributeEnd
AttributeBegin Material "diffuse" "string normalmap" "bumps.png" Translate -1 0 0 Scale .9 .9 1 {SQUARE} AttributeEnd
AttributeBegin Material "conductor" "float uroughness" .3 "float vroughness" .01
Translate 1 0 0 Scale .9 .9 1 {SQUARE} AttributeEnd
AttributeBegin Material "dielectric" Translate 0 -.5 .8 Shape "sphere" "float radius" .3 "float zmax" .29 AttributeEnd
"""


def bumps() -> bytes:
    y, x = np.mgrid[0:32, 0:32]
    normals = np.stack([0.5 * np.sin(x / 3), 0.4 * np.cos(y / 4) + 0.2, np.ones((32, 32))], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    out = io.BytesIO()
    Image.fromarray(np.rint((normals + 1) / 2 * 255).astype(np.uint8)).save(out, "PNG")
    return out.getvalue()


@pytest.mark.long
def test_mirrored_camera_flips_the_picture(scene):
    pictures = []
    for head in (HEAD, "Scale -1 1 1 " + HEAD):
        found = scene("scene.pbrt", world(INSIDE, head), {"bumps.png": bumps()})
        settings = RenderSettings(48, 32, found.cameras[0].view, **chosen({}, found.defaults))
        picture = mean(render_frame(compile_scene(found), settings, 128), settings.film_exponent)[..., :3]
        pictures.append(picture.reshape(8, 4, 12, 4, 3).mean(axis=(1, 3)))
    np.testing.assert_allclose(pictures[0], pictures[1][:, ::-1], rtol=0.1, atol=0.02 * pictures[0].mean())
    assert np.abs(pictures[0] - pictures[1][:, ::-1]).mean() < 0.005 * pictures[0].mean()
