"""Tests of USD: scenes of many files, packages, and paths that leave the scene's folder."""

import threading
import zipfile
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import numpy as np
import pytest
from pxr import Gf, Sdf, UsdGeom, UsdUtils

from renderer.errors import SceneError
from renderer.scene.animation import Moment
from renderer.scene.load import Shot
from tests.renderer.scene.usd_files import TYPES, bind, cube, material, mesh, read, stage, texture, world

MODEL = '#usda 1.0\n(defaultPrim = "m")\ndef Cube "m" {}\n'


def written(folder, **files):
    """Writes text files and returns the path of main.usda. texts: by file stem, with `__` between folder and file."""
    for stem, text in files.items():
        path = folder / f"{stem.replace('__', '/')}.usda"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text if text.startswith("#") else "#usda 1.0\n" + text)
    return folder / "main.usda"


def test_sublayers_references_and_payloads_are_composed(tmp_path):
    main = written(
        tmp_path,
        main='#usda 1.0\n(subLayers = [@./layers/over.usda@])\ndef "a" (references = @parts/ref.usda@) {}\n'
        'def "b" (payload = @parts/ref.usda@</m>) {}\ndef "c" (variants = {\nstring v = "x"\n}\nprepend variantSets = "v") {\n'
        'variantSet "v" = {\n"x" (references = @./parts/ref.usda@) {\n}\n}\n}\n',
        layers__over='over "a" {\ndouble size = 6\n}',
        parts__ref='#usda 1.0\n(defaultPrim = "m"\nsubLayers = [@../deep/model.usda@])\n',
        deep__model=MODEL,
    )  # fmt: skip
    found = read(main)
    assert not found.warnings[:-1]  # only the warning about missing lights
    assert [np.ptp(world(found, k)) for k in range(3)] == pytest.approx([0.06, 0.02, 0.02])  # a unit is 1 cm by default


def test_recursive_and_repeated_sublayers_are_omitted(tmp_path):
    """A sublayer that is the layer itself, or is listed twice, is dropped.

    A path in another folder resolves to a file of the same name next to the layer.
    """
    beside = stage(tmp_path / "b.usda")
    mesh(beside, "/square")
    beside.GetRootLayer().Save()
    made = stage(tmp_path / "a.usda")
    made.GetRootLayer().subLayerPaths = ["one/a.usda", "one/b.usda", "two/b.usda"]
    made.GetRootLayer().Save()
    found = read(tmp_path / "a.usda")
    assert len(found.meshes) == 1
    sentences = " ".join(found.warnings)
    assert "Layers that are their own sublayers are left out (1): a.usda." in sentences
    assert "Layers that are their own sublayers are left out (1): a.usda" in sentences
    assert "anon:" not in sentences


def test_dangling_references_are_named(tmp_path):
    beside = stage(tmp_path / "b.usda")
    mesh(beside, "/square")
    beside.GetRootLayer().Save()
    made = stage(tmp_path / "a.usda")
    mesh(made, "/own")
    made.DefinePrim("/lost").GetReferences().AddReference("b.usda", "/gone")
    made.GetRootLayer().Save()
    said = next(w for w in read(tmp_path / "a.usda").warnings if "lead nowhere" in w)
    assert "@a.usda@" in said
    assert "0x" not in said


def test_missing_layer_is_named(tmp_path):
    main = written(tmp_path, main='def Cube "m" {}\ndef "a" (references = [@sub/chair.usda@, @gone/lamp.usd@</x>]) {}')
    warnings = read(main).warnings
    assert "main.usda: its layer sub/chair.usda is not among the files; add it. Rendered without it until then." in warnings
    assert any("lamp.usd is not among" in w for w in warnings)


SECRET = '#usda 1.0\n(defaultPrim = "m")\ndef Sphere "m" { double radius = 77 }\n'


@pytest.mark.parametrize("way", ["absolute", "upwards", "link", "expression", "arguments", "clips", "asset"])
def test_layers_outside_the_folder_are_not_read(tmp_path, way):
    folder = tmp_path / "scene"
    folder.mkdir()
    secret = tmp_path / "secret.usda"
    secret.write_text(SECRET)
    path = {
        "absolute": str(secret),
        "upwards": "../secret.usda",
        "expression": f'`"{secret}"`',
        "arguments": f"{secret}:SDF_FORMAT_ARGS:a=b",
        "link": "inside.usda",
    }.get(way, "")
    if way == "link":
        (folder / "inside.usda").symlink_to(secret)
    body = f'def "a" (references = @{path}@) {{}}' if path else ""
    if way == "clips":
        body = (
            f'def "a" (clips = {{\ndictionary default = {{\nasset[] assetPaths = [@{secret}@]\nstring primPath = "/m"\n'
            "double2[] active = [(0, 0)]\ndouble2[] times = [(0, 0)]\n}\n}) {\ndouble radius\n}"
        )
    if way == "asset":
        body = f'def DomeLight "d" {{\nasset inputs:texture:file = @{secret}@\n}}'
    main = written(folder, main=f'def Cube "m" {{}}\n{body}\n')
    found = read(main)
    assert len(found.instances) == 1
    assert not found.spheres
    assert any(
        "; add it" in w or "above the scene's folder" in w or "Paths with variables" in w or "Value clips" in w
        for w in found.warnings
    )
    assert not any(str(tmp_path) in w for w in found.warnings)


def test_urls_are_never_requested(tmp_path):
    asked = []

    class Listening(BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append(self.path)

        do_HEAD = do_GET  # noqa: N815

    with ThreadingHTTPServer(("127.0.0.1", 0), Listening) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        url = f"http://127.0.0.1:{server.server_port}/x.usda"
        main = written(
            tmp_path, main=f'#usda 1.0\n(subLayers = [@{url}@])\ndef Cube "m" {{}}\ndef "a" (references = @{url}@) {{}}'
        )
        read(main)
        server.shutdown()
    assert asked == []


def test_cyclic_and_empty_references_are_reported(tmp_path):
    main = written(
        tmp_path,
        main='def Cube "m" {}\ndef "a" (references = [@b.usda@</b>, </nowhere>]) {}',
        b='def "b" (references = @main.usda@</a>) {}',
    )
    assert any(w.startswith("References that lead nowhere are left out") for w in read(main).warnings)


def test_usdz_layers_and_images(tmp_path, png):
    source = tmp_path / "source"
    source.mkdir()
    made = stage(source / "root.usdc")
    (source / "tex").mkdir()
    (source / "tex" / "p.png").write_bytes(png(10, 200, 30))
    made.SetDefaultPrim(UsdGeom.Xform.Define(made, "/r").GetPrim())
    square = mesh(made, "/r/m")
    UsdGeom.PrimvarsAPI(square).CreatePrimvar("st", TYPES.TexCoord2fArray, "vertex").Set([(0, 0), (1, 0), (1, 1), (0, 1)])
    bind(square, material(made, "/r/look", diffuseColor=(TYPES.Color3f, texture(made, "/r/look/t", "./tex/p.png")))[0])
    made.GetRootLayer().Save()
    assert UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(source / "root.usdc")), str(tmp_path / "p.usdz"))
    alone = read(tmp_path / "p.usdz")
    main = written(tmp_path, main='def "a" (references = @p.usdz@) {}\ndef "b" (references = @p.usdz[root.usdc]@</r>) {}')
    for found, count in ((alone, 1), (read(main), 2)):
        assert len(found.instances) == count
        assert found.images[0].pixels[0, 0].tolist() == [10, 200, 30, 255]
        assert found.materials[found.meshes[0].material].base_color_texture == 0


def test_compressed_or_empty_usdz_is_an_error_message(tmp_path):
    for name, data, said in (("a.txt", b"x", "does not begin with a USD layer"), ("a.usda", b"#usda 1.0\n", "")):
        with zipfile.ZipFile(tmp_path / "p.usdz", "w", zipfile.ZIP_DEFLATED) as package:
            package.writestr(name, data * 500)
        with pytest.raises(SceneError, match=f"^p.usdz.*{said}"):
            read(tmp_path / "p.usdz")


def test_usd_udim_tiles_are_combined(tmp_path, png):
    made = stage(tmp_path / "a.usda")
    square = mesh(made, "/m")
    UsdGeom.PrimvarsAPI(square).CreatePrimvar("st", TYPES.TexCoord2fArray, "vertex").Set([(0, 0), (2, 0), (2, 2), (0, 2)])
    bind(square, material(made, "/look", diffuseColor=(TYPES.Color3f, texture(made, "/look/t", "./t.<UDIM>.png")))[0])
    made.GetRootLayer().Save()
    for number, color in ((1001, (255, 0, 0)), (1002, (0, 255, 0)), (1012, (0, 0, 255))):
        (tmp_path / f"t.{number}.png").write_bytes(png(*color))
    found = read(tmp_path / "a.usda")
    pixels, shown = found.images[0].pixels, found.textures[0]
    a, b, c, d, e, f = shown.transform

    def at(s, t):
        u, v = a * s + b * (1 - t) + c, d * s + e * (1 - t) + f
        return pixels[int(v * pixels.shape[0]), int(u * pixels.shape[1]), :3].tolist()

    # Each image has its colour in the upper half and black in the lower.
    assert at(0.5, 0.9) == [255, 0, 0]
    assert at(1.5, 0.9) == [0, 255, 0]
    assert at(1.5, 1.9) == [0, 0, 255]
    assert at(1.5, 1.1) == at(0.5, 1.9) == [0, 0, 0]


def test_scene_file_may_refer_to_usd(tmp_path):
    made = stage(tmp_path / "m.usda", "Z", 0.01)
    cube(made, "/m").AddTranslateOp().Set(Gf.Vec3d(0, 0, 100))
    made.GetRootLayer().Save()
    (tmp_path / "s.yaml").write_text("shapes: [{type: mesh, file: m.usda}]\n")
    placed = world(read(tmp_path / "s.yaml"))
    np.testing.assert_allclose([placed[..., 1].min(), placed[..., 1].max()], [0.99, 1.01], atol=1e-6)


@pytest.mark.parametrize("arc", ["subLayers", "references"])
def test_layer_time_offsets(tmp_path, arc):
    made = stage(tmp_path / "moving.usda")
    ball = UsdGeom.Sphere.Define(made, "/a")
    move = ball.AddTranslateOp()
    for time in (0.0, 10.0):
        move.Set(Gf.Vec3d(time, 0, 0), time)
    made.GetRootLayer().Save()
    offset = "@./moving.usda@ (offset = 20; scale = 2)"
    head = f"subLayers = [{offset}]" if arc == "subLayers" else ""
    over = "" if arc == "subLayers" else 'def "b" (\n references = @./moving.usda@</a> (offset = 20; scale = 2)\n)\n{\n}\n'
    (tmp_path / "a.usda").write_text(f"#usda 1.0\n(\n metersPerUnit = 1\n {head}\n)\n{over}")
    shot = Shot(tmp_path, "a.usda")
    assert shot.scene_at(Moment()).clips[0].end == pytest.approx(20 / 24)
    assert [shot.scene_at(Moment(frame)).spheres[0].center[0] for frame in (0, 5, 20)] == pytest.approx([0, 2.5, 10])
