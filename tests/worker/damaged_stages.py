"""Reads damaged USD files, and prints the error messages: `python -m tests.worker.damaged_stages FOLDER TRIES`.

Prints one JSON line per file suffix. This is a separate, single-threaded program, like a worker's slot: in a process that
writes stages, the USD library has threads. They do not survive a fork, so the forked process would wait for them forever.
"""

from __future__ import annotations

import json
import random
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from pxr import Sdf, UsdGeom, UsdLux, UsdUtils

from renderer.errors import SceneError
from renderer.scene.animation import Moment
from renderer.scene.load import Shot
from tests.bounded import run_bounded
from tests.renderer.scene.usd_files import TYPES, bind, cube, material, stage
from worker.exchange.errors import WorkError

SUFFIXES = ("usda", "usdc", "usdz")
ODD = ["-1", "0", "1e39", "nan", "inf", "2147483648", '""', "None", "[]", "@../../etc/passwd@", "</>", "1e-40"]


def write(folder: Path) -> None:
    """Writes a USD stage with an example of every feature that the reader supports, in each of USD's file formats."""
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


def damaged_copy(suffix: str, data: bytes, rng: random.Random) -> bytes:
    """Returns a damaged copy of a USD file's data.

    suffix: for a text file, usda, odd values replace some numbers and names; for others, some bytes are changed.
    """
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


def read_in_child(work: Callable[[Any], dict[str, Any]], subject: str) -> str:
    """Runs `work`, which reads a file, in a child process with limits of 2 GiB and 60 s. Returns the error message, or "".

    subject: the name of the file in error messages.
    """
    try:
        run_bounded(work, lambda message: None, 2 << 30, 60.0, (SceneError,), subject)
    except WorkError as error:
        return str(error)
    return ""


def error_messages(folder: Path, suffix: str, tries: int) -> list[str]:
    """Reads `tries` damaged copies of the file with this suffix, and returns the error messages."""
    rng = random.Random(7)
    whole = (folder / f"a.{suffix}").read_bytes()
    tried = folder / suffix
    tried.mkdir()

    def work(send: Any) -> dict[str, Any]:
        found = Shot(tried, f"a.{suffix}").scene_at(Moment(2))
        assert all(m.triangles.max(initial=-1) < len(m.positions) for m in found.meshes)
        return {"instances": len(found.instances)}

    sentences = []
    for _ in range(tries):
        (tried / f"a.{suffix}").write_bytes(damaged_copy(suffix, whole, rng))
        sentences.append(read_in_child(work, f"a.{suffix}"))
    return sentences


def main() -> None:
    folder, tries = Path(sys.argv[1]), int(sys.argv[2])

    def made(send: Any) -> dict[str, Any]:
        write(folder)
        return {}

    problem = read_in_child(made, "the stage")
    assert not problem, problem
    for suffix in SUFFIXES:
        print(json.dumps({suffix: error_messages(folder, suffix, tries)}), flush=True)


if __name__ == "__main__":
    main()
