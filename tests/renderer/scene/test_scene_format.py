"""Tests that the pages docs/scene-format*.md, docs/scene-schema.json and scenes/ agree with the reader and the renderer."""

import io
import json
import re
import runpy
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from PIL import Image

from renderer.image.encode import encode
from renderer.kernel.material.blend import OPERATIONS
from renderer.scene.compile import compile_scene
from renderer.scene.load import read
from renderer.scene.parameters import EVERY_KIND
from renderer.scene.readers.metals import METALS
from renderer.scene.readers.yaml.schema import schema as checked_schema
from renderer.settings import OPTIONAL, RenderSettings, View
from tests.renderer.scene.builders import cup
from tests.renderer.scene.ies_files import ies


def test_scene_file_settings_match_the_renderer(scene):
    settings = {
        "width": 64,
        "height": 32,
        "max_depth": 3,
        "seed": 5,
        "integrator": "whitted",
        "sampler": "independent",
        "filter": "tent",
        "sampling": "light",
        "clamp_indirect": 2.5,
        "roulette": 0.8,
        "light_samples": 4,
        "ao_distance": 1.5,
        "ambient": [0.1, 0.1, 0.2],
        "mistake": "attenuation",
    }
    defaults = scene("s.yaml", json.dumps({"settings": settings, "shapes": [{"type": "quad"}]})).defaults
    assert defaults == settings
    view = View((0, 0, 1), (0, 0, 0))
    RenderSettings(view=view, width=64, height=32, **{k: v for k, v in defaults.items() if k not in ("width", "height")})
    known = set(OPTIONAL) | {"width", "height", "spp"}
    assert set(schema()["properties"]["settings"]["properties"]) == known


def schema():
    return json.loads((Path(__file__).parents[3] / "docs" / "scene-schema.json").read_text())


def test_published_settings_table_matches_the_declarations():
    """The published settings table equals the declarations. To update it: python docs/settings_table.py."""
    made = runpy.run_path(str(Path(__file__).parents[3] / "docs" / "settings_table.py"))
    for path, text in ((made["SCHEMA"], made["schema_text"]()), (made["GUIDE"], made["guide_text"](made["GUIDE"].read_text()))):
        assert path.read_text() == text, f"{path.name} is not what docs/settings_table.py writes"


def test_published_schema_matches_the_checked_one():
    def bare(part):
        if isinstance(part, dict):
            return {key: bare(value) for key, value in part.items() if key != "description" or not isinstance(value, str)}
        return [bare(value) for value in part] if isinstance(part, list) else part

    assert bare(schema()) == bare(checked_schema())


def test_the_schema_is_a_json_schema():
    """The schema is a valid JSON Schema; the reader skips this check, which takes 0.25 s."""
    jsonschema.Draft202012Validator.check_schema(checked_schema())


def test_schema_choices_match_the_renderer():
    assert schema()["$defs"]["texture_layer"]["properties"]["blend"]["enum"] == list(OPERATIONS)
    material = schema()["$defs"]["material"]["properties"]
    assert material["metal"]["enum"] == list(METALS)
    assert material["kind"]["enum"] == list(EVERY_KIND)


def guides():
    """Returns the text of all pages about scene files."""
    return "".join(path.read_text() for path in sorted((Path(__file__).parents[3] / "docs").glob("scene-format*.md")))


def examples():
    return [part.split("```")[0] for part in guides().split("```yaml\n")[1:]]


@pytest.mark.parametrize("number", range(len(examples())))
def test_documented_examples_are_valid_scenes(scene, png, number):
    example = examples()[number]
    if example.startswith("transform:"):
        example = "shapes:\n- type: cube\n  " + example.replace("\n", "\n  ")
    if "shapes:" not in example:
        example += "shapes: [{type: quad}]\n"
    images = {"sky.exr": encode(np.ones((2, 4, 3), np.float32), "exr")} | {
        f"{name}.png": png(1, 2, 3) for name in ("wood", "dents", "leaf", "glow", "bricks", "soot", "frost", "window", "rocks")
    }
    profile = ies([0.0, 90.0], [0.0], [[100.0, 0.0]])
    grid = io.BytesIO()
    np.save(grid, np.ones((2, 3, 4), np.float32))
    images |= {name: grid.getvalue() for name in re.findall(r"[\w-]+\.npy", example)}
    others = {
        "cup.glb": cup(),
        "downlight.ies": profile,
        "slide.jpg": png(1, 2, 3),
        "fur.txt": b"0 0 0 0.1\n0 1 0 0.1\n0 2 0 0.1\n0 3 0 0.1\n",
        **images,
    }
    warnings = scene("s.yaml", example, others).warnings
    assert [w for w in warnings if "no light" not in w] == []


def test_the_documentation_names_every_field_of_the_schema():
    text = guides()

    def fields(part):
        if isinstance(part, dict):
            for key, value in part.items():
                if key == "properties":
                    yield from value
                yield from fields(value)
        elif isinstance(part, list):
            for value in part:
                yield from fields(value)

    missing = {name for name in fields(schema()) if f"`{name}`" not in text and f"{name}:" not in text}
    assert missing == set()


@pytest.mark.parametrize("name", ["cornell-box", "spheres", "still-life"])
def test_example_scenes_have_no_warnings(name):
    folder = Path(__file__).parents[3] / "scenes"
    assert (folder / f"{name}.yaml").stat().st_size < 300_000
    assert read(folder, f"{name}.yaml").warnings == []


@pytest.mark.parametrize("script", ["make.py", "lineage.py"])
def test_generated_scenes_match_their_script(script, monkeypatch):
    folder = Path(__file__).parents[3] / "scenes"
    monkeypatch.syspath_prepend(str(folder))
    made = runpy.run_path(str(folder / script))
    for name, scene, comment in made["SCENES"]:
        assert (folder / name).read_text() == made["text_of"](scene(), comment, script)


def test_village_matches_its_script(monkeypatch):
    folder = Path(__file__).parents[3] / "scenes"
    monkeypatch.syspath_prepend(str(folder))
    made = runpy.run_path(str(folder / "christmas.py"))["files"]()
    assert {path.name for path in (folder / "christmas").iterdir()} == set(made)
    for name, content in made.items():
        if isinstance(content, str):
            assert (folder / "christmas" / name).read_text() == content, name
        else:
            kept = np.asarray(Image.open(folder / "christmas" / name)).astype(int)
            assert np.abs(kept - content).max() <= 1, name  # last digits of a power depend on the host


@pytest.mark.long
def test_village_is_small_and_instanced():
    """The village has no warnings, is below 300 kB, and its hundred trees share one mesh."""
    folder = Path(__file__).parents[3] / "scenes" / "christmas"
    assert sum(path.stat().st_size for path in folder.iterdir()) < 300_000
    description = read(folder, "christmas.yaml")
    assert description.warnings == []
    trees = [i for i in description.instances if i.name.startswith("forest")]
    meshes = {i.mesh for i in trees}
    assert len(trees) > 100 * len(meshes)
    compiled = compile_scene(description)
    shown = sum(len(description.meshes[i.mesh].triangles) for i in description.instances)
    assert len(compiled.triangle) < shown / 8
    stacks = {
        m.name
        for m in description.materials
        for t in (m.base_color_texture, m.emission_texture)
        if t is not None and description.textures[t].layers
    }
    assert stacks == {"walls", "windows", "ice", "sooty bricks"}
    assert len(compiled.light_primitive) > 200
