import io

import numpy as np
import pytest
from PIL import Image

from renderer.scene.load import read
from tests.renderer.scene.samples import write


@pytest.fixture
def scene(tmp_path):
    """Returns a function `scene(name, data, **further_files)` that writes the files and reads the first as a scene."""

    def read_scene(name, data, others=None, **options):
        for file, content in {name: data, **(others or {})}.items():
            path = tmp_path / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return read(tmp_path, name, **options)

    return read_scene


@pytest.fixture(scope="session")
def png():
    """Returns a function `png(r, g, b)` that makes a 2 x 2 PNG with that colour in the upper row and black in the lower."""

    def make(r, g, b):
        pixels = np.zeros((2, 2, 3), np.uint8)
        pixels[0] = r, g, b
        out = io.BytesIO()
        Image.fromarray(pixels).save(out, "PNG")
        return out.getvalue()

    return make


@pytest.fixture(scope="session")
def samples(tmp_path_factory):
    """Returns a folder of sample files written by another program."""
    folder = tmp_path_factory.mktemp("samples")
    write(folder)
    return folder
