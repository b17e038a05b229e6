"""Small valid files of every format with many features, as input for damage."""

from __future__ import annotations

import gzip
import io
import tempfile
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from PIL import Image
from pxr import Usd, UsdShade

from renderer.formats import SCENE_SUFFIXES
from renderer.image.encode import encode
from tests.benchmarks.mutations.packed import blends, packed_gltf, serialized_mesh, textures, zips
from tests.benchmarks.mutations.seed import Seed
from tests.benchmarks.mutations.tail import long_tail
from tests.peers.test_mitsuba_files import SHAPES, write_files
from tests.renderer.scene import samples, usd_files
from tests.renderer.scene.builders import full_gltf, moving_gltf
from tests.renderer.scene.fbx_text import fbx, light, material, node
from tests.renderer.scene.pbrt_files import BALL, SQUARE, world
from tests.renderer.scene.test_assimp import collada
from tests.renderer.scene.test_threemf import RELATIONS, model, package, solid

__all__ = ["from_folders", "seeds"]

_LARGEST = 60_000  # largest file taken from a folder, in bytes
_OF_ONE = 6  # files per suffix
_FBX = Path(__file__).parents[2] / "data" / "fbx" / "kit.fbx"
_STL = (
    "solid a\n"
    + "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 1e-1\nendloop\nendfacet\n" * 4
    + "endsolid a\n"
)
_SERIALIZED = b'<scene version="3.0.0"><shape type="serialized"><string name="filename" value="m.serialized"/></shape></scene>'
_YAML = """name: Toy
settings: {width: 64, height: 32, spp: 4}
cameras: [{name: front, eye: [0, 1.5, {keys: [[0, 6], [2, 3]]}], target: [0, 0.8, 0], fov: 35}]
environment: {sky: {sun_elevation: 12, sun_azimuth: 210}, strength: 3}
textures: {squares: {checker: {colors: ["#e9dfcd", "#9c3b35"], squares: 8}}, skin: {image: skin.png, scale: 2}}
materials:
  cloth: {texture: squares}
  brass: {kind: conductor, metal: brass, roughness: 0.25}
  lamp: {color: 0, emission: [12, 10, 8]}
shapes:
  - {type: quad, material: cloth, transform: [{scale: 3}, {rotate: {axis: x, degrees: -90}}]}
  - {type: sphere, material: brass, center: [0, 1, 0], radius: 1}
  - {type: mesh, file: m.obj, transform: [{translate: [1.5, 0, 1]}]}
  - {type: disk, material: lamp, transform: [{rotate: {axis: x, degrees: 90}}, {translate: [0, 4, 0]}]}
"""
_PBRT = f"""AttributeBegin AreaLightSource "diffuse" "rgb L" [9 8 7] Translate 0 2 0 Rotate 90 1 0 0 {SQUARE} AttributeEnd
Texture "skin" "spectrum" "imagemap" "string filename" "skin.png" "float uscale" 2
Texture "squares" "spectrum" "checkerboard" "texture tex1" "skin" "rgb tex2" [.1 .2 .3]
MakeNamedMaterial "board" "string type" "coateddiffuse" "texture reflectance" "squares" "float roughness" 0.1
NamedMaterial "board" {SQUARE}
Material "conductor" "spectrum eta" "metal-Au-eta" "spectrum k" "metal-Au-k" "float uroughness" .1 "float vroughness" .3
ObjectBegin "pair" {BALL} "float zmax" 0.5 Shape "plymesh" "string filename" "m.ply" ObjectEnd
ActiveTransform EndTime Translate 1 0 0 ActiveTransform All ObjectInstance "pair" Identity
Include "more.pbrt"
Shape "loopsubdiv" "integer indices" [0 1 2 0 2 3] "point3 P" [0 0 0 1 0 0 1 1 1 0 1 0] "integer levels" 2
Shape "bilinearmesh" "point3 P" [0 0 0 1 0 0 0 1 0 1 1 1] "string emissionfilename" ""
Shape "curve" "point3 P" [0 0 0 1 0 0 1 1 0 2 1 0] "float width0" .2 "float width1" 0.01
LightSource "infinite" "string filename" "sky.exr" LightSource "spot" "blackbody I" 3000 "float power" 10
"""


def _png(r: int = 200, g: int = 100, b: int = 50) -> bytes:
    pixels = np.zeros((8, 8, 3), np.uint8)
    pixels[:4] = r, g, b
    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "PNG")
    return out.getvalue()


def _usd(folder: Path) -> list[Seed]:
    made = usd_files.stage(folder / "a.usda", "Z", 0.01)
    prim = usd_files.cube(made, "/World/box", scheme="catmullClark")
    usd_files.mesh(made, "/World/square")
    surface, _ = usd_files.material(made, "/World/red", diffuseColor=(usd_files.TYPES.Color3f, (0.8, 0.1, 0.1)))
    usd_files.bind(prim, surface)
    made.GetRootLayer().Save()
    Usd.Stage.Open(str(folder / "a.usda")).GetRootLayer().Export(str(folder / "a.usdc"))
    from pxr import UsdUtils

    UsdUtils.CreateNewUsdzPackage(str(folder / "a.usda"), str(folder / "a.usdz"))
    looks = usd_files.MTLX % ""
    shown = usd_files.stage(folder / "looks.usda")
    look = UsdShade.Material.Define(shown, "/look")
    look.GetPrim().GetReferences().AddReference("looks.mtlx", "/MaterialX/Materials/Look")
    usd_files.bind(usd_files.mesh(shown, "/World/square"), look)
    shown.GetRootLayer().Save()
    with_looks = {"looks.usda": (folder / "looks.usda").read_bytes(), "looks.mtlx": looks.encode()}
    alone = [Seed(name, {name: (folder / name).read_bytes()}) for name in ("a.usda", "a.usdc", "a.usdz")]
    return [*alone, Seed("looks.usda", with_looks, ("looks.mtlx",))]


def from_folders(folders: Iterable[Path]) -> dict[str, list[Seed]]:
    """Returns, for each scene suffix, up to six small scene files found in the folders, without the files that they refer to."""
    found: dict[str, list[Path]] = defaultdict(list)
    for path in sorted(path for folder in folders for path in folder.rglob("*")):
        if path.suffix.lower() in SCENE_SUFFIXES and path.is_file() and 20 < path.stat().st_size < _LARGEST:
            found[path.suffix.lower()].append(path)
    chosen = {suffix: sorted(paths, key=lambda path: path.stat().st_size) for suffix, paths in found.items()}
    return {
        suffix: [
            Seed(f"a{suffix}", {f"a{suffix}": path.read_bytes()}) for path in paths[:: max(len(paths) // _OF_ONE, 1)][:_OF_ONE]
        ]
        for suffix, paths in chosen.items()
    }


def seeds() -> dict[str, list[Seed]]:
    """Returns the valid scenes to be damaged, by format."""
    png = _png()
    with tempfile.TemporaryDirectory(prefix="rayfarm-seeds-") as name:
        folder = Path(name)
        samples.write(folder)
        write_files(folder)
        taken = {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        usd = _usd(folder)
    glb = [(each.glb(), "a.glb") for each in (full_gltf(_png), moving_gltf(_png))] + [(taken["toy.glb"], "toy.glb")]
    parts = {each.removeprefix("parts/"): data for each, data in taken.items() if each.startswith("parts/")}
    painted = {each.removeprefix("painted/"): data for each, data in taken.items() if each.startswith("painted/")}
    peers = {each: taken[each] for each in ("m.obj", "m.ply", "t.png", "painted.xml")}
    things = material(30, "red", DiffuseColor=(0.8, 0.1, 0.1), ShininessExponent=30.0) + node(50, "lamp", "Light")
    text = fbx(things + light(60, Intensity=200.0, DecayType=2), [(30, 20), (60, 50), (50, 0)])
    sky = encode(np.ones((8, 8, 3), np.float32), "exr")
    beside = {"skin.png": png, "m.ply": taken["m.ply"], "sky.exr": sky, "more.pbrt": f'Material "dielectric" {BALL}'.encode()}
    group = '<object id="2"><components><component objectid="1" transform="0 1 0 -1 0 0 0 0 1 5 0 0"/></components></object>'
    build = '<item objectid="2"/><item objectid="1"/>'
    threemf = package(model(solid() + group, build))
    inside = {"_rels/.rels": RELATIONS.encode(), "3D/main.model": model(solid() + group, build).encode()}
    whole = Seed("scene.pbrt", {"scene.pbrt": world(_PBRT).encode(), **beside})
    packed_too = {"scene.pbrt": world('Include "more.pbrt.gz"').encode(), "more.pbrt.gz": gzip.compress(SQUARE.encode())}
    ours = {"scene.yaml": _YAML.encode(), "m.obj": taken["m.obj"], "skin.png": png}
    return {
        ".blend": blends(),
        "glTF (.glb)": [Seed(file, {file: data}) for data, file in glb],
        "glTF (.gltf)": [Seed(next(file for file in parts if file.endswith(".gltf")), parts)],
        "glTF, packed": packed_gltf(),
        "USD": usd,
        "FBX": [Seed("kit.fbx", {"kit.fbx": _FBX.read_bytes()}), Seed("text.fbx", {"text.fbx": text.encode()})],
        "OBJ + MTL": [Seed("painted.obj", painted), Seed("body.obj", {"body.obj": taken["body.obj"]})],
        "Collada": [Seed("a.dae", {"a.dae": collada().encode()}), Seed("body.dae", {"body.dae": taken["body.dae"]})],
        "3MF": [Seed("a.3mf", {"a.3mf": threemf}), *[Seed("a.3mf", inside, ("3D/main.model",), is_package=True)] * 3],
        "PLY": [Seed(file, {file: taken[file]}) for file in ("body.ply", "ascii.ply")],
        "STL": [Seed("body.stl", {"body.stl": taken["body.stl"]}), Seed("a.stl", {"a.stl": _STL.encode()})],
        "OFF": [Seed("a.off", {"a.off": b"OFF\n4 2 0\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n3 0 1 2\n3 0 2 3\n"})],
        "Mitsuba": [
            *[Seed("scene.xml", {"scene.xml": text.encode(), **peers}) for text in SHAPES.values()],
            Seed("scene.xml", {"scene.xml": _SERIALIZED, "m.serialized": serialized_mesh()}, ("m.serialized",)),
        ],
        "pbrt": [whole, Seed("scene.pbrt", packed_too)],
        "Rayfarm's own": [Seed("scene.yaml", ours)],
        "textures": textures(),
        "the long tail": long_tail(),
        "zip": zips(ours),
    }
