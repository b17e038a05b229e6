"""Damaged USD files in the bounded child: a scene or a sentence, and the worker lives on."""

import random
import re

import pytest
from pxr import Sdf, UsdGeom, UsdLux, UsdUtils

from renderer.errors import SceneError
from renderer.scene.animation import Moment
from renderer.scene.load import Shot
from tests.renderer.scene.usd_files import TYPES, bind, cube, material, stage
from worker.exchange.errors import WorkError
from worker.work.bounded import run_bounded

ODD = ["-1", "0", "1e39", "nan", "inf", "2147483648", '""', "None", "[]", "@../../etc/passwd@", "</>", "1e-40"]
TRIES = 8


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    """The bytes of one stage with a little of everything, by suffix."""
    folder = tmp_path_factory.mktemp("usd")
    made = stage(folder / "a.usda", "Z", 0.01)
    made.SetDefaultPrim(UsdGeom.Xform.Define(made, "/w").GetPrim())
    box = cube(made, "/w/box", scheme="catmullClark")
    box.CreateCreaseIndicesAttr([0, 1, 2])
    box.CreateCreaseLengthsAttr([3])
    box.CreateCreaseSharpnessesAttr([2.0])
    bind(box, material(made, "/w/look", roughness=(TYPES.Float, 0.25))[0])
    UsdGeom.PrimvarsAPI(box).CreatePrimvar("st", TYPES.TexCoord2fArray, "vertex").Set([(0, 0)] * 8)
    box.AddRotateXYZOp().Set((1, 2, 3), 0)
    instancer = UsdGeom.PointInstancer.Define(made, "/w/many")
    cube(made, "/w/many/one")
    instancer.CreatePrototypesRel().SetTargets(["/w/many/one"])
    instancer.CreateProtoIndicesAttr([0, 0])
    instancer.CreatePositionsAttr([(1, 2, 3), (4, 5, 6)])
    UsdLux.SphereLight.Define(made, "/w/lamp").CreateIntensityAttr(3.0)
    UsdGeom.Camera.Define(made, "/w/camera").AddTranslateOp().Set((0, -9, 0))
    made.GetRootLayer().Save()
    made.GetRootLayer().Export(str(folder / "a.usdc"))
    assert UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(folder / "a.usdc")), str(folder / "a.usdz"))
    return {suffix: (folder / f"a.{suffix}").read_bytes() for suffix in ("usda", "usdc", "usdz")}


def damaged(suffix, data, rng):
    """Odd values in place of numbers and names, or bytes that are others."""
    if suffix == "usda":
        text = data.decode()
        for _ in range(rng.randint(1, 3)):
            place = rng.choice(list(re.finditer(r'-?\d+\.?\d*|"[^"]*"|<[^>]*>', text)))
            text = text[: place.start()] + rng.choice(ODD) + text[place.end() :]
        return text.encode()
    many = bytearray(data)
    for _ in range(rng.choice((1, 4, 16))):
        many[rng.randrange(len(many))] = rng.randrange(256)
    return bytes(many)


@pytest.mark.parametrize("suffix", ["usda", "usdc", "usdz"])
def test_a_damaged_stage_is_a_scene_or_a_sentence(sources, tmp_path, suffix):
    rng = random.Random(7)
    told = 0
    for _ in range(TRIES):
        (tmp_path / f"a.{suffix}").write_bytes(damaged(suffix, sources[suffix], rng))

        def work(send):
            found = Shot(tmp_path, f"a.{suffix}").at(Moment(2))
            assert all(m.triangles.max(initial=-1) < len(m.positions) for m in found.meshes)
            return {"instances": len(found.instances)}

        try:
            run_bounded(work, lambda message: None, 2 << 30, 120.0, (SceneError,), f"a.{suffix}")
        except WorkError as error:
            told += 1
            assert str(error).startswith((f"a.{suffix}: ", f"a.{suffix}[")), error
            assert "crash" not in str(error)
            assert str(tmp_path) not in str(error)
    assert told < TRIES or suffix != "usda"  # of so small a binary file, most bytes matter
